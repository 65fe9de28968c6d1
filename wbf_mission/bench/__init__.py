"""Benchmarks: specification, execution, storage and statistics of many comparable runs."""
