"""Execution of a run: resolving, planning, flights, estimate and record."""
