"""Clocks, links and the state that interfaces show."""
