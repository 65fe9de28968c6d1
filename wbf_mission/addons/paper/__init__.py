"""The figures of the Waterberry Farms paper (arXiv:2305.06243), reproduced."""
