"""PX4: motion of a multirotor under PX4's control."""
