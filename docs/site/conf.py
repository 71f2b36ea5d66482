"""The settings of Sphinx for the documentation site; ``docs/site/build.py`` runs Sphinx."""

import os

from mission_service import __version__

project = "mission-service"
version = release = __version__
copyright = "the authors of mission-service"
language = "en"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

html_theme = "furo"  # fonts of the system; no page loads anything from another server
html_title = f"mission-service {__version__}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
templates_path: list[str] = []
html_baseurl = ""

source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
myst_heading_anchors = 4  # the anchors of headings are those of the repository's page
myst_enable_extensions = ["attrs_inline"]
suppress_warnings = ["myst.header"]  # pages of docstrings begin with headings of other levels
nb_execution_mode = "off" if os.environ.get("NOTEBOOKS") == "off" else "force"
nb_execution_timeout = 300  # s for a cell
nb_execution_show_tb = True  # a failed cell is a warning, therefore an error
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True, "show-inheritance": True}
napoleon_numpy_docstring = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80
pygments_style = "default"
pygments_dark_style = "monokai"
