"""The guidance of prescribed burns, and the approval of ignition plans. Pure."""
