"""Default time of day of a simulation."""

from __future__ import annotations

__all__ = ["EPOCH_UNIX_S"]

EPOCH_UNIX_S = 1_780_315_200.0
"""Unix time of simulation time 0, 2026-06-01T12:00:00Z; a constant, so that equal runs give equal logs."""
