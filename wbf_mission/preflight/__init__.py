"""Preflight check: faults of a plan and of the vehicle, found before the upload."""
