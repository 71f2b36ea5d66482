"""Fire as ellipses from points and lines, for many ignitions at once."""
