"""Sticks as an autopilot takes them: the modes that they fly, how far they move the vehicle, and their loss.

Sources: PX4's ``Sticks.cpp``, ``failsafe.cpp`` and parameter reference; ArduCopter's ``mode_loiter.cpp``,
``mode_althold.cpp``, ``radio.cpp`` and ``events.cpp``; Rover's ``mode_manual.cpp`` and ``failsafe.cpp``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.behaviour import Action
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.parameters import Setting

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["Axis", "StickLoss", "StickRules", "Sticks", "TiltSticks", "WingSticks", "bits"]


@dataclass(frozen=True, slots=True)
class Sticks:
    """Positions of the sticks, -1 to 1."""

    # The middle is 0; ``turn`` counts clockwise.
    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True, slots=True)
class Axis:
    """Share of the greatest speed that a stick asks for.

    Examples
    --------
    >>> px4 = Axis(0.1, 0.6)
    >>> px4.share(0.05), px4.share(1.0), round(px4.share(-0.5), 3)
    (0.0, 1.0, -0.23)
    """

    deadzone: float
    """About the middle."""
    expo: float = 0.0
    """Share of the cube, which makes small moves finer."""

    def share(self, value: float) -> float:
        """Share of the greatest speed at a position of the stick, both -1 to 1."""
        size = min(abs(value), 1.0)
        if size <= self.deadzone:
            return 0.0
        size = (size - self.deadzone) / (1.0 - self.deadzone)
        return math.copysign((1.0 - self.expo) * size + self.expo * size**3, value)


@dataclass(frozen=True, slots=True)
class StickLoss:
    """Reaction of an autopilot when its sticks fall silent."""

    timeout: Setting
    """Silence after which they are lost."""
    action: Setting
    """Chooses among ``actions``."""
    actions: Mapping[int, Action]
    exceptions: Mapping[Mode, int]
    """The bit of `RuntimeParameters.failsafe_options` with which a mode goes on without sticks."""
    in_stick_modes: Action = Action.NONE
    """The least that is done in a mode that the sticks fly (PX4 cannot stay in it)."""
    release: Setting | None = None
    """Silence after which the sticks are let go where nothing else is done; negative is never. None is
    ``timeout``."""
    delay: Setting | None = None
    """How long it holds before it does more than that (PX4)."""
    on_ground: Action = Action.NONE
    """Action on the ground."""
    arming: Setting | None = None
    """A parameter with which a vehicle whose sticks are lost does not arm, unless it is 0 (ArduPilot)."""
    # Texts, empty for none; ``delayed`` has a ``{}`` for the seconds.
    lost: str = ""
    delayed: str = ""
    regained: str = ""
    ignored: Mapping[Mode, str] = field(default_factory=dict)
    """Notice when a mode goes on without sticks."""


@dataclass(frozen=True, slots=True)
class WingSticks:
    """How far a fixed wing goes with its sticks."""

    bank: Setting
    """Greatest angle, radians."""
    # What the stick for the pitch asks for at its ends: pitch angles in radians, or vertical speeds in m/s;
    # the sign does not count.
    up: Setting
    down: Setting
    by_rate: bool = False
    """``up`` and ``down`` are vertical speeds."""


@dataclass(frozen=True, slots=True)
class TiltSticks:
    """How a multirotor leans with its sticks."""

    holds_height: frozenset[Mode]
    """Modes in which the vertical stick is a climb rate, and the height is held without it."""
    by_throttle: frozenset[Mode]
    """Modes in which it is the thrust."""
    by_rate: frozenset[int]
    """Custom modes, flown as one of ``by_throttle``, in which the sticks are rates of turning."""
    lean: Setting
    """Greatest lean, radians."""
    # Greatest rates of turning in ``by_rate``, radians a second.
    roll_rate: Setting
    pitch_rate: Setting
    yaw_rate: Setting
    # Thrust with the stick in the middle and at its ends.
    hover_thrust: Setting
    least_thrust: Setting
    most_thrust: Setting
    hold_below: Setting
    """Vertical speed below which the height is held, m/s."""
    drag: Callable[[VehicleSpec], float]
    """Drag over mass and airspeed (1/s) of a vehicle."""


@dataclass(frozen=True, slots=True)
class StickRules:
    """How an autopilot flies by sticks."""

    speeds: Mapping[Mode, Setting | None]
    """The modes that sticks fly, with the speed of a stick that is moved all the way; None is the vehicle's
    greatest."""
    loss: StickLoss
    # Sticks for the horizontal movement, for climbing and for turning.
    level: Axis
    vertical: Axis
    turning: Axis
    turn_rate: Setting
    """Rate of a turn, radians a second; of a rover 0 is the vehicle's own."""
    # Vertical speeds; None and 0 are the vehicle's own.
    climb: Setting | None = None
    descent: Setting | None = None
    without: frozenset[int] = field(default_factory=frozenset)
    """Custom modes that are flown as one of ``speeds``, but without sticks."""
    coordinated: frozenset[int] = frozenset()
    """Custom modes in which the stick to the right turns the vehicle (DRIFT)."""
    needed: frozenset[Mode] = field(default_factory=frozenset)
    """Modes that are not entered in flight, and in which the vehicle does not arm, without sticks (PX4)."""
    impossible: frozenset[Mode] = field(default_factory=frozenset)
    """Modes that are not entered at all in flight, and in which the vehicle does not arm (PX4)."""
    overrides: bool = False
    """RC_CHANNELS_OVERRIDE is taken, and only from the ground station that MAV_GCS_SYSID names
    (ArduPilot)."""
    drives: bool = False
    """A rover: the vertical stick is the throttle, the one to the right steers."""
    wings: Mapping[Mode, WingSticks] = field(default_factory=dict)
    """A fixed wing: the horizontal sticks ask for bank and pitch, in each mode that they fly."""
    landing_abort: Setting | None = None
    """Not 0: with the throttle all the way up a landing of the mission is broken off (ArduPlane)."""
    tilt: TiltSticks | None = None
    """A multirotor that leans with its sticks in some modes, without a position to hold."""
    takeoff_stick: float = 0.0
    """Where the vertical stick has to be for a vehicle that stands to take off."""
    receiver: Sticks | None = None
    """The sticks of a radio receiver, which count until a ground station's are heard; None without one."""
    throttle_middle: float = 500.0
    """Where the middle of MANUAL_CONTROL's throttle is, 0 to 1000."""
    pwm_half: float = 500.0
    """Microseconds from the middle of a channel to its end."""


def bits(**modes: int) -> Mapping[Mode, int]:
    """Bits by mode.

    Examples
    --------
    >>> bits(MISSION=1)[Mode.MISSION]
    1
    """
    return {Mode[name]: bit for name, bit in modes.items()}
