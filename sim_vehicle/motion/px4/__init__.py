"""A multirotor's motion as PX4 controls it."""
