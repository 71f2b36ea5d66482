"""Products for crews and incident staff, written from a journal: maps, GIS files, KMZ, logs."""
