"""Ground station: upload, arming, start, changes in flight, and monitoring of a mission."""
