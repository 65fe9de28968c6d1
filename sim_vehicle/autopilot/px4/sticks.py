"""PX4's sticks: joysticks by MANUAL_CONTROL (COM_RC_IN_MODE 1), on multirotors in position control."""

from __future__ import annotations

import math
from types import MappingProxyType

from sim_vehicle.autopilot.failsafe_rules import Action, actions_by_value
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.setting import Setting
from sim_vehicle.autopilot.stick_rules import Axis, StickLoss, StickRules, bits

__all__ = ["STICKS"]

_AXIS = Axis(0.1, 0.6)
STICKS = StickRules(
    speeds=MappingProxyType({Mode.POSITION: Setting("MPC_VEL_MANUAL", 10.0)}),
    needed=frozenset({Mode.POSITION, Mode.ALTITUDE, Mode.MANUAL}),
    level=_AXIS,
    vertical=_AXIS,
    turning=_AXIS,
    turn_rate=Setting("MPC_MAN_Y_MAX", 150.0, math.radians(1.0)),
    loss=StickLoss(
        timeout=Setting("COM_RC_LOSS_T", 0.5),
        action=Setting("NAV_RCL_ACT", 2.0),
        actions=actions_by_value(NONE="0", HOLD="1", RETURN="2", LAND="3", TERMINATE="5", DISARM="6"),
        exceptions=bits(MISSION=1, HOLD=2, TAKEOFF=2, LAND=2, RTL=2, GUIDED=4),
        in_stick_modes=Action.RETURN,
        delay=Setting("COM_FAIL_ACT_T", 5.0),
        lost="Failsafe activated",
        delayed="Failsafe activated: entering Hold for {:.0f} seconds",
    ),
)
