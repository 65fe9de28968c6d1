"""A run: its flights, one after the other or ahead, and the estimate over all of them."""
