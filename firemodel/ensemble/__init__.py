"""Burn many fires that differ by what is uncertain: wind, moisture, spread rates, ignition.

``draws`` has the distributions, ``members`` the fires (``Ensemble``, ``burned_windows``) and
``products`` what they give together: burn probability, arrival times, flame lengths.
"""
