"""Policies and estimators from the papers and code of the benchmark's authors."""
