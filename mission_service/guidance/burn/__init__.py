"""Prescribed burns: ignition lines, whole burns, approval of plans. Pure; see ARCHITECTURE.md."""
