"""Treatment maps: readings of a flight, zones, files for GIS, sprayer and farmer, and the next flight."""
