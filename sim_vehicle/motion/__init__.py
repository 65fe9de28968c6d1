"""Vehicle motion: motion models and their numba kernels."""
