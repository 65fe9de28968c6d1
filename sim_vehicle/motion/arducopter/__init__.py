"""A multirotor's motion as ArduCopter controls it."""
