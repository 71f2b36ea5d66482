"""Fire model and planners whose decisions fly as MAVLink missions."""

__version__ = "0.2.0"
