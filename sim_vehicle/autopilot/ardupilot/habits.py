"""How ArduPilot takes a mission that is changed while it flies, and how ArduCopter comes up.

Sources: ArduPilot ``AP_Mission.cpp``, ArduCopter ``mode_auto.cpp`` and ``mode_guided.cpp``, and what
ArduCopter 4.7 (SITL) was seen to do.
"""

from __future__ import annotations

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.cold_boot import BootStage, ColdBoot
from sim_vehicle.autopilot.mission_habits import MissionHabits
from sim_vehicle.autopilot.modes import Mode

__all__ = ["COLD_BOOT", "HABITS"]

_HOME = frozenset({int(m.MAVLINK_MSG_ID_HOME_POSITION)})
_PLACE = _HOME | {int(m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT), int(m.MAVLINK_MSG_ID_GPS_RAW_INT)}
_ACCELS, _GYROS = "Accels inconsistent", "Gyros inconsistent"
# Times of ArduCopter 4.7 (SITL), in its own seconds.
COLD_BOOT = ColdBoot(
    stages=(
        BootStage(0.0, _ACCELS, untold=_PLACE),
        BootStage(8.5, _ACCELS, untold=_HOME),
        BootStage(10.0, _ACCELS, fix=1, tells_place=True, untold=_HOME),
        BootStage(10.2, _ACCELS, fix=6, tells_place=True, untold=_HOME),
        BootStage(18.5, _GYROS, fix=6, tells_place=True, untold=_HOME),
        BootStage(20.0, _GYROS, fix=6, tells_place=True, text="EKF3 IMU0 origin set"),
        BootStage(23.5, fix=6, tells_place=True),
        BootStage(40.0, fix=6, tells_place=True, knows_position=True, text="EKF3 IMU0 is using GPS"),
    ),
    blind_flags=167,
    blind_modes=frozenset({Mode.MANUAL, Mode.ALTITUDE}),
    no_position="Need Position Estimate",
)

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
