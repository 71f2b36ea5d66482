"""Events to commands: the state machine of a run. Pure."""
