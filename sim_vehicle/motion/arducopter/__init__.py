"""ArduCopter: motion of a multirotor under ArduPilot's control."""
