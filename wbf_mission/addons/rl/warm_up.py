"""Compiles the training environments ahead, for ``wbf-mission warm-up``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wbf_mission.addons.rl.vector_env import SurveyVectorEnv


def warm_up(begin: Callable[[str], None]) -> None:
    """Take a step of the environment that is compiled."""
    begin("training environments")
    # Arrays of a single run are contiguous where those of several are not, and are compiled for apart.
    envs = SurveyVectorEnv(2, "WBF/Miniberry-10-v1")
    envs.reset(seed=0)
    envs.step(np.zeros(2, np.int64))
    envs.close()
