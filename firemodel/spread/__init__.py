"""Simulate fire spread over a landscape.

``schemes`` lists the spread schemes, ``fire_scheme`` is the common base of the schemes, and
``burning`` creates the initial state from an existing fire. ``behaviour`` computes spread rate,
direction and intensity. ``firemodel.outputs`` writes files and draws maps.
"""
