"""Help in shells and editors: completion, manual pages, the schema of scenarios."""
