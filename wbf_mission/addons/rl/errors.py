"""Errors of training environments, and a check of the libraries that they need."""

from __future__ import annotations

import importlib.util

from geo.errors import WbfMissionError


class TrainingError(WbfMissionError, ValueError):
    """A training environment cannot be created, or is used wrongly."""


def require_libraries() -> None:
    """Raise TrainingError if a library of the extra is missing."""
    missing = [name for name in ("gymnasium", "pettingzoo") if importlib.util.find_spec(name) is None]
    if missing:
        raise TrainingError(
            f"training environments need {' and '.join(missing)}: install with pip install 'wbf-mission[rl]'"
        )
