"""Formations of fixed wings that loiter around a fire by virtual agents, after the paper's method.

All modules are pure: they use no clock, network or random source. Positions are metres, x east and
y north, in the landscape's CRS; angles are radians anticlockwise from its east.
"""
