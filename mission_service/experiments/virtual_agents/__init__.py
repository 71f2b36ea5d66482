"""Run the experiments of the "Virtual agents" paper: fixed wings in formation around a fire."""
