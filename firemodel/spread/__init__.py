"""Simulate fire spread over a landscape.

``schemes`` lists the spread schemes, ``fire_scheme`` is their common base, and ``burning`` starts
from an existing fire. ``behaviour`` computes spread rate, direction and intensity.
``firemodel.outputs`` writes files and draws maps.
"""
