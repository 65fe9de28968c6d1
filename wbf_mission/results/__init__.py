"""Results, and the folders that hold them."""
