"""Run the experiments of the "Virtual agents" paper: fixed-wing UAVs in formation."""
