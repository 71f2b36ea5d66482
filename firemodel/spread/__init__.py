"""Fire spread over a landscape: schemes, fronts, and maps and files of the results.

``schemes`` lists the spread schemes, ``fire_scheme`` is their common base, ``burning`` starts from
an existing fire; ``behaviour``, ``writers`` and ``arrival_map`` compute and write the results.
"""
