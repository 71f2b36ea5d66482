"""Simulate fire spread over a landscape.

``schemes`` lists the spread schemes, ``fire_scheme`` is their common base, and ``burning`` starts
from an existing fire. ``behaviour`` computes results; ``firemodel.outputs`` writes and draws them.
"""
