"""Sums of an estimate over pixels and blocks of cells, and the report for the farmer."""
