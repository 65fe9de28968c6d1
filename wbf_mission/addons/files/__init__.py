"""Files and logs of a simulated vehicle over MAVLink."""
