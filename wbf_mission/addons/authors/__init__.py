"""Policies and estimators from the papers and the published code of the benchmark's authors."""
