"""Tokens, roles and limits of HTTP clients."""
