"""The state of each vehicle: availability, missions on board and in transfer, separation."""
