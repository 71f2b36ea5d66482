"""Run Beachly's experiments: ignition lines, and corrections of a fire model."""
