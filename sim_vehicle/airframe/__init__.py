"""The vehicle: its specification, the catalogue of vehicles, the errors of its sensors."""
