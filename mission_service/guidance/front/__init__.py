"""The guidance of vehicles along a fire front, with a separate planner for each vehicle."""
