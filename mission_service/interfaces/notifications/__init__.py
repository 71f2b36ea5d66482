"""Sends alarms to people: by e-mail, text message, webhook and other services."""
