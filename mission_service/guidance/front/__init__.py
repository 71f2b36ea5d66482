"""The guidance of vehicles that fly along a fire front, each with its own planner."""
