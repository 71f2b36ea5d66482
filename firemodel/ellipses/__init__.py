"""Fire as ellipses from many point and line ignitions, on level ground.

``ellipse`` computes arrival times at any place, ``observations`` their errors against observations.
"""
