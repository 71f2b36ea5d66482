"""The page in which a user describes a new incident; it makes the scenario file."""

from mission_service.interfaces.incident_form.form_options import Form, options_of
from mission_service.interfaces.incident_form.form_server import FormServer, uploads_of

__all__ = ["Form", "FormServer", "options_of", "uploads_of"]
