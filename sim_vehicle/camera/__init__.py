"""MAVLink camera components."""
