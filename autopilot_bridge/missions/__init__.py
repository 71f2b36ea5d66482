"""Mission items in files and over the wire: reading, checks, transfers."""
