"""Fire model, planners, and MAVLink missions that carry out the planners' decisions."""

__version__ = "0.2.0"
