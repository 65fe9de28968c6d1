"""Specification of a vehicle: kinematic limits, battery, power model."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from geo.texts import FOOT_M
from sim_vehicle.airframe.kind import (
    NO_AUTOPILOT,
    Movement,
    VehicleKind,
    autopilot_names,
    get_kind,
    kind_names,
)
from sim_vehicle.airframe.power_spec import AnyPowerSpec, BatterySpec, positive, within
from sim_vehicle.errors import VehicleError

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
    """Endurance published by the manufacturer."""

    endurance_min: float
    airspeed_m_s: float = 0.0
    """Airspeed of the flight; 0 for hover."""
    used_fraction: float = 1.0
    """Fraction of the battery that the flight uses."""
    # Conditions of the published flight, and the source of the figures.
    condition: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        positive("published", self, "endurance_min", "used_fraction")
        if not 0.0 <= self.airspeed_m_s < 200.0 or self.used_fraction > 1.0:
            raise VehicleError(
                f"published: airspeed_m_s {self.airspeed_m_s} must be 0 to 200, "
                f"used_fraction {self.used_fraction} at most 1"
            )


@dataclass(frozen=True, slots=True)
class VehicleSpec:
    """Specification of a vehicle: limits and defaults of the motion, battery, power model.

    Examples
    --------
    >>> VehicleSpec("mine", speed_limit_m_s=10.0).top_speed_m_s
    9.5
    """

    name: str
    """Name for reports."""
    kind: str = "multirotor"
    """Kind of the vehicle, one of `sim_vehicle.airframe.kind.kind_names`."""
    autopilot: str = NO_AUTOPILOT
    """Autopilot that controls the motion: one of `sim_vehicle.airframe.kind.autopilot_names`, or "generic"
    for the generic motion."""
    parameters: tuple[tuple[str, float], ...] = ()
    """Names and values of the autopilot parameters that differ from their defaults."""
    cruise_speed_m_s: float = 8.0
    """Ground speed on missions that set no speed."""
    speed_limit_m_s: float = 14.0
    """Limit of the horizontal ground speed; a mission may command up to 95 % of the limit."""
    airspeed_limit_m_s: float = 16.0
    """Limit of the horizontal airspeed, which bounds the ground speed in wind."""
    # Limits of the vertical speed; `landing_speed_m_s` applies near the ground during landing.
    climb_speed_m_s: float = 4.0
    descent_speed_m_s: float = 3.0
    landing_speed_m_s: float = 0.7
    # Limits of the horizontal acceleration and jerk vectors.
    # Motion along the path uses 80 % of both limits, and corners use the rest (docs/vehicle-model.md).
    acceleration_m_s2: float = 3.75
    jerk_m_s3: float = 5.0
    # Limits of the vertical acceleration and jerk.
    vertical_acceleration_m_s2: float = 2.5
    vertical_jerk_m_s3: float = 5.0
    # Limits of the yaw rate and yaw acceleration.
    yaw_rate_rad_s: float = math.radians(60.0)
    yaw_acceleration_rad_s2: float = math.radians(120.0)
    acceptance_radius_m: float = 1.0
    """Acceptance radius of waypoints that set no radius."""
    # Default take-off altitude, minimum return altitude and ceiling, all above home.
    takeoff_altitude_m: float = 10.0
    return_altitude_m: float = 15.0
    max_altitude_m: float = 500.0
    max_distance_m: float = 20_000.0
    """Limit of the distance from the start."""
    step_s: float = 0.02
    """Time step of the motion model."""
    disarm_delay_s: float = 2.0
    """Time from touch-down to disarming."""
    cell_m: float = FOOT_M
    """Length of one step of the ideal vehicle."""
    linear_drag_1_s: float | None = None
    """Linear drag over mass of a multirotor; None for the drag of the autopilot's reference airframe."""
    attitude_response_s: float | None = None
    """Time constant with which the tilt follows its setpoint; None for the reference airframe's constant."""
    battery: BatterySpec | None = None
    """Battery; None for unlimited energy."""
    power: AnyPowerSpec | None = None
    """Power model of the vehicle's kind; None if the vehicle uses no energy."""
    airframe: Any = None
    """Airframe of the vehicle's kind; None for a typical airframe."""
    return_margin_m: float = 0.0
    """Margin that is added to the distance from home before the return altitude is computed, because a return
    may begin farther away than planned. The margin is 0 in flight; `sim_vehicle.autopilot.with_return_margin`
    sets it for a prediction of the cost of a return."""
    autopilot_parameters: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    """Parameters of the vehicle for each autopilot, as pairs of name and value."""
    published: PublishedEndurance | None = None
    """Endurance published by the manufacturer, for comparison with the model."""
    description: str = ""
    """Short description, for lists."""

    def __post_init__(self) -> None:
        where = f"vehicle {self.name}"
        for name, known in (("kind", kind_names()), ("autopilot", (*autopilot_names(), NO_AUTOPILOT))):
            value = getattr(self, name)
            if value not in known:
                raise VehicleError(f"{where}: {name} {value!r} is not one of {', '.join(known)}")
        positive(where, self, *(f.name for f in fields(self) if f.name not in _NO_LIMITS))
        within(where, self, ("linear_drag_1_s", 0.0, 10.0), ("attitude_response_s", 0.02, 10.0))
        if not 0.0 <= self.disarm_delay_s < 3600.0:
            raise VehicleError(f"{where}: disarm_delay_s {self.disarm_delay_s} is outside 0..3600")
        if not self.return_margin_m >= 0.0:
            raise VehicleError(f"{where}: return_margin_m {self.return_margin_m} must not be negative")
        if self.battery is not None and self.power is None:
            raise VehicleError(f"{where}: a battery needs a power model ([power])")
        kind = self.vehicle_kind
        for part, wanted, what in (
            (self.power, kind.power, "power model"),
            (self.airframe, kind.airframe, "airframe"),
        ):
            if part is not None and not isinstance(part, wanted or ()):
                raise VehicleError(f"{where}: {type(part).__name__} is no {what} of kind {self.kind}")

    @property
    def vehicle_kind(self) -> VehicleKind:
        """Properties of the vehicle's kind."""
        return get_kind(self.kind)

    @property
    def is_ideal(self) -> bool:
        """Whether the vehicle is the paper's robot, without dynamics."""
        return self.vehicle_kind.movement is Movement.STEPS

    @property
    def drives(self) -> bool:
        """Whether the vehicle stays on the ground, so that take-offs and heights are ignored."""
        return self.vehicle_kind.movement is Movement.DRIVES

    @property
    def circles(self) -> bool:
        """Whether the vehicle must circle to hold its position."""
        return self.vehicle_kind.movement is Movement.CIRCLES

    @property
    def hovers(self) -> bool:
        """Whether the vehicle can hover."""
        return self.vehicle_kind.movement is Movement.HOVERS

    def reaches(self, height_m: float) -> bool:
        """Return whether the vehicle may fly at this height above home."""
        return self.drives or 0.0 < height_m <= self.max_altitude_m

    def parameters_for(self, autopilot: str) -> tuple[tuple[str, float], ...]:
        """Return the parameters that the vehicle sets for an autopilot."""
        return dict(self.autopilot_parameters).get(autopilot, ())

    @property
    def top_speed_m_s(self) -> float:
        """Highest ground speed that a mission can command."""
        return self.cell_m / self.step_s if self.is_ideal else 0.95 * self.speed_limit_m_s

    @property
    def fastest_m_s(self) -> float:
        """Highest speed in still air that a mission can command and the airframe can reach.

        In wind, only `airspeed_limit_m_s` limits the airspeed, so the airspeed can be higher.
        """
        return self.top_speed_m_s if self.is_ideal else min(self.top_speed_m_s, self.airspeed_limit_m_s)
