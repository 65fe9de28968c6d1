"""How PX4 takes a mission that is changed while it flies.

Sources: PX4 v1.17 ``mission_base.cpp``, ``mission.cpp``, ``mavlink_mission.cpp``, and what PX4 1.17 (SIH) was
seen to do.
"""

from __future__ import annotations

from sim_vehicle.autopilot.mission_habits import MissionHabits
from sim_vehicle.autopilot.mission_rules import px4_takeoff_and_landing

__all__ = ["HABITS"]

HABITS = MissionHabits(
    replays_speed=True,
    rewinds_survey=True,
    return_lag_s=0.3,
    finished_texts=("Mission finished, loitering", "Mission finished, landed"),
    return_text="Returning to launch",
    no_mission_text="No valid mission available, loitering",
    unknown_current_s=0.5,
    refuses=px4_takeoff_and_landing,
)
