"""Compute fires that grow as ellipses from point and line ignitions on level ground.

``ellipse`` computes arrival times at any place, ``point_observations`` computes the errors of these
times against observations.
"""
