"""Missions: planners, mission files, the MAVLink mission protocol and links."""
