"""Training environments for Gymnasium and PettingZoo (docs/training.md); the import registers their ids.

>>> import gymnasium
>>> import wbf_mission.addons.rl
>>> gymnasium.make("WBF/Miniberry-30-v1").action_space
Discrete(5)
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wbf_mission.addons.rl.catalogue import Interfaces as Interfaces
    from wbf_mission.addons.rl.catalogue import TrainingError as TrainingError
    from wbf_mission.addons.rl.catalogue import interfaces as interfaces
    from wbf_mission.addons.rl.env import SurveyEnv as SurveyEnv
    from wbf_mission.addons.rl.env import SurveyParallelEnv as SurveyParallelEnv
    from wbf_mission.addons.rl.env import parallel_env as parallel_env
    from wbf_mission.addons.rl.task import MOVE_NAMES as MOVE_NAMES
    from wbf_mission.addons.rl.vector_env import SurveyVectorEnv as SurveyVectorEnv
else:
    from geo.imports import attach
    from wbf_mission.addons.rl.catalogue import register_all

    register_all()
    __getattr__, __dir__, __all__ = attach(__name__)
