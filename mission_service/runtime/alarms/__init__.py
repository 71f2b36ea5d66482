"""The alarms and announcements of a run, and the conditions that raise and clear them. Pure."""
