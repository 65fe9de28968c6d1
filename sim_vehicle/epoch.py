"""The time of day of a simulation that is not given one."""

from __future__ import annotations

__all__ = ["EPOCH_UNIX_S"]

EPOCH_UNIX_S = 1_780_315_200.0
"""Time of day at time 0, 2026-06-01T12:00:00Z: fixed, so that equal runs give equal logs."""
