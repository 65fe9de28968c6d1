"""Policies and estimators after the papers and the code of the benchmark's authors."""
