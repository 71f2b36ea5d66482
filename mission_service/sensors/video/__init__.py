"""Thermal video with MISB ST 0601 metadata: received, decoded, and converted to images."""
