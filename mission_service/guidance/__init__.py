"""The guidance for each way of flying: along a front, in a team, in formation, or over a burn."""
