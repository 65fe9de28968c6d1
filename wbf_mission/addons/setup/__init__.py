"""Set-up of a simulated vehicle: calibrations and outputs."""
