"""Fixed wings under PX4 and ArduPlane."""
