"""What to fly: missions, planners, files, the MAVLink mission protocol and links."""
