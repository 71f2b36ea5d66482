"""Fixed wings that loiter around a fire over virtual agents: the paper of that name, and beyond.

Everything here is pure: no clock, no network, no randomness of its own. Positions are metres, x
east and y north in the landscape's frame; angles are radians anticlockwise from east, as there.
"""
