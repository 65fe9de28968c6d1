"""Compiles the training environments ahead of use, for ``wbf-mission warm-up``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wbf_mission.addons.rl.vector_env import SurveyVectorEnv


def warm_up(begin: Callable[[str], None]) -> None:
    """Step the compiled environment once."""
    begin("training environments")
    # Two runs, because arrays of a single run are contiguous and would be compiled separately.
    envs = SurveyVectorEnv(2, "WBF/Miniberry-10-v1")
    envs.reset(seed=0)
    envs.step(np.zeros(2, np.int64))
    envs.close()
