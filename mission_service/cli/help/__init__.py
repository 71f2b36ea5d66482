"""Help in shells and editors: completion, manual pages and the scenario schema."""
