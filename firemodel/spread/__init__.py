"""Fire that spreads over a landscape: schemes, fronts, maps and files of the result.

``schemes`` lists the spread schemes, ``fire`` is what they share, ``burning`` starts from a fire
that is there already, ``behaviour``, ``writers`` and ``arrival_map`` give the results.
"""
