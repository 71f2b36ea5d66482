"""The guidance of teams: several vehicles that divide a fire front among themselves."""
