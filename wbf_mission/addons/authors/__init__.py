"""Policies after the papers and the code of the benchmark's authors."""
