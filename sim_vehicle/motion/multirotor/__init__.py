"""Jerk-limited motion of a multirotor of no autopilot in particular."""
