"""The MAVLink mission protocol as sans-IO state machines, both roles."""
