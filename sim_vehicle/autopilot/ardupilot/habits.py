"""How ArduPilot takes a mission that is changed while it flies.

Sources: ArduPilot ``AP_Mission.cpp``, ArduCopter ``mode_auto.cpp`` and ``mode_guided.cpp``, and what
ArduCopter 4.7 (SITL) was seen to do.
"""

from __future__ import annotations

from sim_vehicle.autopilot.mission_habits import MissionHabits
from sim_vehicle.autopilot.modes import Mode

__all__ = ["HABITS"]

HABITS = MissionHabits(
    restarts_leg=True,
    clamps_item=False,
    obeys_mark=False,
    keeps_jumps=True,
    clears_in_flight=False,
    stays_after_last=True,
    forgets_speed_in=frozenset({Mode.MISSION, Mode.GUIDED}),
    pauses_shots=False,
    tells_shots=True,
    changed_texts=("Mission: {} WP", "Auto mission changed, restarted command"),
    restart_failed_text="Auto mission changed but failed to restart command",
    empty_mission_text="Mode requires mission",
    stopped_state=True,
)
