"""When an armed vehicle that stands on the ground is disarmed by its autopilot.

Sources: ArduCopter's ``motors.cpp`` (DISARM_DELAY), PX4's ``Commander.cpp`` (COM_DISARM_PRFLT).
"""

from __future__ import annotations

from dataclasses import dataclass

from sim_vehicle.autopilot.setting import Setting

__all__ = ["IdleDisarm"]


@dataclass(frozen=True, slots=True)
class IdleDisarm:
    """The rule of one firmware.

    Parameters
    ----------
    delay : Setting
        Time on the ground, in seconds; 0 and less is for ever.
    texts : tuple of str
        What is said.
    first_flight : bool
        It is only for a vehicle that has not taken off since it was armed (PX4, which has another delay after
        a landing). Otherwise each time on the ground counts, with the throttle stick down or without sticks
        (ArduCopter); a vehicle that lands by itself does not wait for it.
    """

    delay: Setting
    texts: tuple[str, ...]
    first_flight: bool = False
