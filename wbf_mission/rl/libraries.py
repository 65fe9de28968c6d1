"""The libraries of the extra ``rl``."""

import importlib.util

from wbf_mission.rl.errors import TrainingError

__all__ = ["require_libraries"]


def require_libraries() -> None:
    """Raise TrainingError if a library of the extra is not installed."""
    missing = [name for name in ("gymnasium", "pettingzoo") if importlib.util.find_spec(name) is None]
    if missing:
        msg = (
            f"training environments need {' and '.join(missing)}: install with pip install 'wbf-mission[rl]'"
        )
        raise TrainingError(msg)
