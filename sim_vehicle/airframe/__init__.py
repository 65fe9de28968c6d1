"""What a vehicle is: its specification, the catalogue of vehicles, the errors of its sensors."""
