"""The map in the browser: its TypeScript sources, and their build."""
