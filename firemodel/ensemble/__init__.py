"""Simulate ensembles: fires with random errors in wind, moisture, spread rates and ignition.

``uncertainty`` defines the distributions of the errors, and ``draws`` draws errors from these
distributions. ``member_fires`` simulates the members (``Ensemble``, ``burned_windows``).
``products`` computes burn probability, arrival times and flame lengths from the members.
"""
