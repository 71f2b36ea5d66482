"""Fire as ellipses from points and lines, on level ground, for many ignitions at once.

``ellipse`` gives the time of ignition anywhere, ``observations`` the errors against observations.
"""
