"""What a vehicle can do: kinematic limits, battery, power model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Literal

from geo.units import FOOT_M
from sim_vehicle.airframe.autopilot_names import NO_AUTOPILOT, autopilot_names
from sim_vehicle.airframe.power_spec import (
    AIR_DENSITY_KG_M3,
    GRAVITY_M_S2,
    AnyPowerSpec,
    BatterySpec,
    FixedWingAirframe,
    FixedWingPowerSpec,
    PowerSpec,
    RoverPowerSpec,
    positive,
)
from sim_vehicle.errors import VehicleError

__all__ = [
    "AIR_DENSITY_KG_M3",
    "GRAVITY_M_S2",
    "KINDS",
    "POWER_OF_KIND",
    "AnyPowerSpec",
    "BatterySpec",
    "FixedWingAirframe",
    "FixedWingPowerSpec",
    "PowerSpec",
    "PublishedEndurance",
    "RoverPowerSpec",
    "VehicleSpec",
]

KINDS = ("multirotor", "fixed-wing", "rover", "ideal")
POWER_OF_KIND: Mapping[str, type[AnyPowerSpec]] = MappingProxyType(
    {"multirotor": PowerSpec, "fixed-wing": FixedWingPowerSpec, "rover": RoverPowerSpec}
)
_NO_LIMITS = (
    "name",
    "kind",
    "autopilot",
    "parameters",
    "battery",
    "power",
    "airframe",
    "autopilot_parameters",
    "published",
    "description",
    "disarm_delay_s",
    "linear_drag_1_s",
    "attitude_response_s",
    "return_margin_m",
)


@dataclass(frozen=True, slots=True)
class PublishedEndurance:
    """How long a vehicle flies as its maker tells it.

    Parameters
    ----------
    endurance_min : float
        Minutes.
    airspeed_m_s : float
        0 for hovering.
    used_fraction : float
        Share of the battery that the flight takes.
    condition, source : str
        As published, and where.
    """

    endurance_min: float
    airspeed_m_s: float = 0.0
    used_fraction: float = 1.0
    condition: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        positive("published", self, "endurance_min", "used_fraction")
        if not 0.0 <= self.airspeed_m_s < 200.0 or self.used_fraction > 1.0:
            msg = (
                f"published: airspeed_m_s {self.airspeed_m_s} must be 0 to 200, "
                f"used_fraction {self.used_fraction} at most 1"
            )
            raise VehicleError(msg)


@dataclass(frozen=True, slots=True)
class VehicleSpec:
    """A vehicle: limits that its motion never exceeds, defaults, battery and power model.

    Parameters
    ----------
    name : str
        Name for reports.
    kind : {"multirotor", "fixed-wing", "rover", "ideal"}
        The motion model.
    autopilot : str
        The autopilot that moves it, one of `sim_vehicle.airframe.autopilot_names.autopilot_names`; "generic"
        is none in particular.
    parameters : tuple of (str, float)
        Parameters of the autopilot that are not at their defaults, under their real names.
    cruise_speed_m_s : float
        Ground speed on a mission that does not set one.
    speed_limit_m_s : float
        Horizontal ground speed that is never exceeded; a mission may command up to 95 % of it.
    airspeed_limit_m_s : float
        Horizontal airspeed that the vehicle can hold; bounds the ground speed in a wind.
    climb_speed_m_s, descent_speed_m_s, landing_speed_m_s : float
        Vertical speeds: never exceeded; the last one near the ground while landing.
    acceleration_m_s2, jerk_m_s3 : float
        Bounds on the horizontal acceleration and jerk vectors; 80 % of each is used along the path, the
        rest is kept for corners (see docs/vehicle-model.md).
    vertical_acceleration_m_s2, vertical_jerk_m_s3 : float
        Bounds on the vertical acceleration and jerk.
    yaw_rate_rad_s, yaw_acceleration_rad_s2 : float
        Bounds on the turning of the heading.
    acceptance_radius_m : float
        Distance at which a waypoint that sets none is passed.
    takeoff_altitude_m, return_altitude_m, max_altitude_m : float
        Default take-off height, least return altitude, and ceiling, all above home.
    max_distance_m : float
        Farthest allowed position from home.
    step_s : float
        Time step of the motion model.
    disarm_delay_s : float
        Time from touch-down to disarming.
    cell_m : float
        Length of one step of the ideal vehicle.
    linear_drag_1_s : float or None
        Drag of a multirotor per mass and airspeed; None is that of the autopilot's reference airframe.
    attitude_response_s : float or None
        Time in which its tilt follows what the autopilot wants; None is that of the reference airframe.
    battery : BatterySpec or None
        None is an endless battery.
    power : PowerSpec, FixedWingPowerSpec, RoverPowerSpec or None
        The one of its kind; None uses no energy.
    airframe : FixedWingAirframe or None
        Of a fixed wing; None is a typical one.
    return_margin_m : float
        How much farther from home than planned a return may begin: a return altitude that depends on the
        distance is that of so much more. 0 for a vehicle that flies; where a way home is priced it is what
        `sim_vehicle.autopilot.with_return_margin` says.
    autopilot_parameters : tuple of (str, tuple of (str, float))
        Per autopilot, the parameters for when it flies this vehicle, under their real names.
    published : PublishedEndurance or None
        What the maker of such a vehicle tells, to compare the model with.
    description : str
        In a few words, for lists.

    Examples
    --------
    >>> VehicleSpec("mine", speed_limit_m_s=10.0).top_speed_m_s
    9.5
    """

    name: str
    kind: Literal["multirotor", "fixed-wing", "rover", "ideal"] = "multirotor"
    autopilot: str = NO_AUTOPILOT
    parameters: tuple[tuple[str, float], ...] = ()
    cruise_speed_m_s: float = 8.0
    speed_limit_m_s: float = 14.0
    airspeed_limit_m_s: float = 16.0
    climb_speed_m_s: float = 4.0
    descent_speed_m_s: float = 3.0
    landing_speed_m_s: float = 0.7
    acceleration_m_s2: float = 3.75
    jerk_m_s3: float = 5.0
    vertical_acceleration_m_s2: float = 2.5
    vertical_jerk_m_s3: float = 5.0
    yaw_rate_rad_s: float = math.radians(60.0)
    yaw_acceleration_rad_s2: float = math.radians(120.0)
    acceptance_radius_m: float = 1.0
    takeoff_altitude_m: float = 10.0
    return_altitude_m: float = 15.0
    max_altitude_m: float = 500.0
    max_distance_m: float = 20_000.0
    step_s: float = 0.02
    disarm_delay_s: float = 2.0
    cell_m: float = FOOT_M
    linear_drag_1_s: float | None = None
    attitude_response_s: float | None = None
    battery: BatterySpec | None = None
    power: AnyPowerSpec | None = None
    airframe: FixedWingAirframe | None = None
    return_margin_m: float = 0.0
    autopilot_parameters: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    published: PublishedEndurance | None = None
    description: str = ""

    def __post_init__(self) -> None:
        for name, known in (("kind", KINDS), ("autopilot", (*autopilot_names(), NO_AUTOPILOT))):
            value = getattr(self, name)
            if value not in known:
                msg = f"vehicle {self.name}: {name} {value!r} is not one of {', '.join(known)}"
                raise VehicleError(msg)
        positive(f"vehicle {self.name}", self, *(f.name for f in fields(self) if f.name not in _NO_LIMITS))
        for name, least in (("linear_drag_1_s", 0.0), ("attitude_response_s", 0.02)):
            value = getattr(self, name)
            if value is not None and not least <= value <= 10.0:
                msg = f"vehicle {self.name}: {name} {value!r} is outside {least:g}..10"
                raise VehicleError(msg)
        if not 0.0 <= self.disarm_delay_s < 3600.0:
            msg = f"vehicle {self.name}: disarm_delay_s {self.disarm_delay_s} is outside 0..3600"
            raise VehicleError(msg)
        if not self.return_margin_m >= 0.0:
            msg = f"vehicle {self.name}: return_margin_m {self.return_margin_m} must not be negative"
            raise VehicleError(msg)
        if self.battery is not None and self.power is None:
            msg = f"vehicle {self.name}: a battery needs a power model ([power])"
            raise VehicleError(msg)
        wanted = POWER_OF_KIND.get(self.kind)
        if self.power is not None and (wanted is None or not isinstance(self.power, wanted)):
            msg = f"vehicle {self.name}: {type(self.power).__name__} is no power model of kind {self.kind}"
            raise VehicleError(msg)
        if self.airframe is not None and self.kind != "fixed-wing":
            msg = f"vehicle {self.name}: [airframe] belongs to a fixed wing, not to a {self.kind}"
            raise VehicleError(msg)

    @property
    def is_ideal(self) -> bool:
        """Whether it is the paper's robot, without dynamics."""
        return self.kind == "ideal"

    def parameters_for(self, autopilot: str) -> tuple[tuple[str, float], ...]:
        """Parameters of its own for when that autopilot flies it."""
        return dict(self.autopilot_parameters).get(autopilot, ())

    @property
    def top_speed_m_s(self) -> float:
        """The highest ground speed that a mission can command."""
        return self.cell_m / self.step_s if self.is_ideal else 0.95 * self.speed_limit_m_s

    @property
    def fastest_m_s(self) -> float:
        """Greatest speed in still air: the most that a mission can command and the airframe reaches.

        A wind is withstood up to ``airspeed_limit_m_s``, which a commanded ground speed does not bound.
        """
        return self.top_speed_m_s if self.is_ideal else min(self.top_speed_m_s, self.airspeed_limit_m_s)
