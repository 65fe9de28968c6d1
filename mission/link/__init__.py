"""Links that carry MAVLink bytes: in memory, UDP, TCP."""
