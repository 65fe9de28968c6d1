"""Mission files: QGroundControl plans, WPL 110 waypoint lists and our own JSON."""
