"""Uses a real camera on a companion computer as the camera of a vehicle."""
