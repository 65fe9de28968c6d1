"""Where things are: units, the local frame, farms, their cells and farm files."""
