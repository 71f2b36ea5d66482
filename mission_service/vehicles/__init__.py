"""What is known of each vehicle: availability, mission on board, mission under way, separation."""
