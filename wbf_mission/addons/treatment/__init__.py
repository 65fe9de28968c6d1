"""Treatment maps: from readings to the files for GIS, sprayer and farmer, and to the next flight."""
