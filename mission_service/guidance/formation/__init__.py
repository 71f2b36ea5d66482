"""The guidance of formations: fixed wings loiter around a fire by the paper's virtual agents.

All modules are pure: they use no clock, network or random source. Positions are in metres in the
landscape's CRS, with x east and y north. Angles are in radians, anticlockwise from the CRS's east.
"""
