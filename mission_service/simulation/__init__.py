"""Virtual time, mock autopilots as processes, the demo."""
