"""The state of each vehicle: availability, missions on board and under way, separation."""
