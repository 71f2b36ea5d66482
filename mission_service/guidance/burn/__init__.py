"""Prescribed burns: ignition lines, whole burns, approval. Pure; see ARCHITECTURE.md."""
