"""Verification of journals, decisions of other planners on journals, and logged flights."""
