"""The air: mean wind, shear, gusts."""
