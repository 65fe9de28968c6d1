"""Ground vehicles as ArduPilot's Rover drives them."""
