"""Flight by sticks under an autopilot: modes, speeds and angles, and the failsafe for lost sticks.

Sources: PX4's ``Sticks.cpp``, ``failsafe.cpp`` and parameter reference; ArduCopter's ``mode_loiter.cpp``,
``mode_althold.cpp``, ``radio.cpp`` and ``events.cpp``; Rover's ``mode_manual.cpp`` and ``failsafe.cpp``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.behaviour import Action, Mode
from sim_vehicle.autopilot.parameters import Setting

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec


@dataclass(frozen=True, slots=True)
class Sticks:
    """Positions of the sticks, -1 to 1."""

    # 0 is the centre; ``turn`` is positive clockwise.
    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True, slots=True)
class Axis:
    """Response of a stick axis: setpoint divided by maximum speed.

    Examples
    --------
    >>> px4 = Axis(0.1, 0.6)
    >>> px4.share(0.05), px4.share(1.0), round(px4.share(-0.5), 3)
    (0.0, 1.0, -0.23)
    """

    deadzone: float
    """Deadzone around the centre."""
    expo: float = 0.0
    """Fraction of the cubic term, which reduces the response near the centre."""

    def share(self, value: float) -> float:
        """Return setpoint divided by maximum speed for a stick position, both -1 to 1."""
        size = min(abs(value), 1.0)
        if size <= self.deadzone:
            return 0.0
        size = (size - self.deadzone) / (1.0 - self.deadzone)
        return math.copysign((1.0 - self.expo) * size + self.expo * size**3, value)


@dataclass(frozen=True, slots=True)
class StickLoss:
    """Failsafe of an autopilot for lost sticks."""

    timeout: Setting
    """Time without stick input after which sticks are lost."""
    action: Setting
    """Parameter that selects one of ``actions``."""
    actions: Mapping[int, Action]
    exceptions: Mapping[Mode, int]
    """Bits of `RuntimeParameters.failsafe_options` that let a mode continue without sticks, by mode."""
    in_stick_modes: Action = Action.NONE
    """Minimum action in modes flown by sticks (PX4 cannot stay in such a mode)."""
    release: Setting | None = None
    """Time without stick input after which the sticks count as centred if no action follows. If the
    time is negative, they are never centred; None selects the time in ``timeout``."""
    delay: Setting | None = None
    """Time for which the vehicle holds before an action other than hold (PX4)."""
    on_ground: Action = Action.NONE
    """Action while the vehicle is on the ground."""
    arming: Setting | None = None
    """Parameter that prevents arming without sticks unless it is 0 (ArduPilot)."""
    # Notices, empty for none; ``{}`` in ``delayed`` is the delay in seconds.
    lost: str = ""
    delayed: str = ""
    regained: str = ""
    ignored: Mapping[Mode, str] = field(default_factory=dict)
    """Notice in a mode that continues without sticks."""


@dataclass(frozen=True, slots=True)
class WingSticks:
    """Limits of a fixed wing under stick control."""

    bank: Setting
    """Maximum bank angle (rad)."""
    # Pitch angles (rad) or vertical speeds (m/s) at the ends of the pitch stick; signs are ignored.
    up: Setting
    down: Setting
    by_rate: bool = False
    """Whether ``up`` and ``down`` are vertical speeds."""


@dataclass(frozen=True, slots=True)
class TiltSticks:
    """Attitude control of a multirotor by sticks."""

    holds_height: frozenset[Mode]
    """Modes in which the vertical stick sets the climb rate; with the stick centred the height is held."""
    by_throttle: frozenset[Mode]
    """Modes in which the vertical stick sets the thrust."""
    by_rate: frozenset[int]
    """Custom modes in which sticks set body rates; each is simulated as a mode in ``by_throttle``."""
    lean: Setting
    """Maximum lean angle (rad)."""
    # Maximum body rates in ``by_rate`` (rad/s).
    roll_rate: Setting
    pitch_rate: Setting
    yaw_rate: Setting
    # Thrust with the stick at the centre and at its ends.
    hover_thrust: Setting
    least_thrust: Setting
    most_thrust: Setting
    hold_below: Setting
    """Vertical speed below which the height is held (m/s)."""
    drag: Callable[[VehicleSpec], float]
    """Function that returns the drag of a vehicle divided by mass and airspeed (1/s)."""


@dataclass(frozen=True, slots=True)
class StickRules:
    """Flight by sticks under an autopilot."""

    speeds: Mapping[Mode, Setting | None]
    """Modes flown by sticks, with the speed at full stick; None selects the maximum speed of the vehicle."""
    loss: StickLoss
    # Axes of horizontal motion, climb and yaw.
    level: Axis
    vertical: Axis
    turning: Axis
    turn_rate: Setting
    """Yaw rate at full stick (rad/s); for a rover, 0 selects the vehicle's own rate."""
    # Vertical speeds at full stick; None and 0 select the vehicle's own speeds.
    climb: Setting | None = None
    descent: Setting | None = None
    without: frozenset[int] = field(default_factory=frozenset)
    """Custom modes that are simulated as a mode in ``speeds``, but ignore sticks."""
    coordinated: frozenset[int] = frozenset()
    """Custom modes in which the roll stick turns the vehicle (DRIFT)."""
    needed: frozenset[Mode] = field(default_factory=frozenset)
    """Modes that can be entered in flight, and allow arming, only with sticks (PX4)."""
    impossible: frozenset[Mode] = field(default_factory=frozenset)
    """Modes that cannot be entered in flight and do not allow arming (PX4)."""
    overrides: bool = False
    """Whether RC_CHANNELS_OVERRIDE is accepted from the ground station with id MAV_GCS_SYSID (ArduPilot)."""
    drives: bool = False
    """Whether the vehicle is a rover: throttle on the vertical stick, steering on the roll stick."""
    wings: Mapping[Mode, WingSticks] = field(default_factory=dict)
    """Bank and pitch limits of a fixed wing, by mode."""
    landing_abort: Setting | None = None
    """Parameter that is not 0 if full throttle aborts a landing of the mission (ArduPlane)."""
    tilt: TiltSticks | None = None
    """Attitude control of a multirotor in modes without position hold; None without such modes."""
    takeoff_stick: float = 0.0
    """Position of the vertical stick at which a vehicle on the ground takes off."""
    receiver: Sticks | None = None
    """Sticks of a radio receiver, used until sticks of a ground station arrive; None without a receiver."""
    throttle_middle: float = 500.0
    """Centre of the throttle in MANUAL_CONTROL, 0 to 1000."""
    pwm_half: float = 500.0
    """Pulse range from the centre of an RC channel to its end (us)."""


def bits(**modes: int) -> Mapping[Mode, int]:
    """Return bits by mode, from keywords with the names of the modes.

    Examples
    --------
    >>> bits(MISSION=1)[Mode.MISSION]
    1
    """
    return {Mode[name]: bit for name, bit in modes.items()}
