"""Verification of journals, other planners on them, and flown logs."""
