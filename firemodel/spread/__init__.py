"""Simulate fire spread over a landscape, and draw and write the results.

``schemes`` lists the spread schemes, ``fire_scheme`` is their common base, and ``burning`` starts
from an existing fire. ``behaviour`` computes results, ``writers`` writes them and ``arrival_map``
draws them.
"""
