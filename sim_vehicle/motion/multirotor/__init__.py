"""Generic multirotor: jerk-limited motion without a particular autopilot."""
