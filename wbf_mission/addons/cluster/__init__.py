"""Flies benchmarks on the workers of a Dask cluster."""
