"""Wind: mean wind, shear, gusts."""
