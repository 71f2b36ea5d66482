"""What PX4 and ArduPilot do differently: modes and rules of items."""
