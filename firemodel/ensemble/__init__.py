"""Burn many fires that differ by what is uncertain: wind, moisture, spread rates, ignition.

``uncertainty`` states the distributions and ``draws`` draws from them. ``member_fires`` has the
fires (``Ensemble``, ``burned_windows``) and ``products`` what they give together: burn probability,
arrival times, flame lengths.
"""
