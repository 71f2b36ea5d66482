"""Fire physics: landscapes, fuels, Rothermel's surface model, spread over cells, fire fronts."""
