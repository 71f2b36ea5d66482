"""The ways of flying: along a front, in a team, in formation, igniting a burn."""
