"""How vehicles move: numba kernels and the motion models around them."""
