"""Several vehicles that divide a fire front."""
