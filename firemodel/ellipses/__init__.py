"""Compute fires that grow as ellipses from point and line ignitions on level ground.

``ellipse`` computes arrival times at any position, ``point_observations`` compares these times with
observations.
"""
