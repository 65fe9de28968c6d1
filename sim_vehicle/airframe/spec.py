"""Specification of a vehicle: kinematic limits, battery, power model."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from geo.units import FOOT_M
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

__all__ = ["PublishedEndurance", "VehicleSpec"]

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
    """Endurance of a vehicle as published by its maker."""

    endurance_min: float
    """Minutes."""
    airspeed_m_s: float = 0.0
    """0 for hovering."""
    used_fraction: float = 1.0
    """Share of the battery that the flight takes."""
    # As published, and where.
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

    Examples
    --------
    >>> VehicleSpec("mine", speed_limit_m_s=10.0).top_speed_m_s
    9.5
    """

    name: str
    """Name for reports."""
    kind: str = "multirotor"
    """One of `sim_vehicle.airframe.kind.kind_names`."""
    autopilot: str = NO_AUTOPILOT
    """The autopilot that moves it, one of `sim_vehicle.airframe.kind.autopilot_names`; "generic"
    is none in particular."""
    parameters: tuple[tuple[str, float], ...] = ()
    """Parameters of the autopilot that are not at their defaults, under their real names."""
    cruise_speed_m_s: float = 8.0
    """Ground speed on a mission that does not set one."""
    speed_limit_m_s: float = 14.0
    """Horizontal ground speed that is never exceeded; a mission may command up to 95 % of it."""
    airspeed_limit_m_s: float = 16.0
    """Horizontal airspeed that the vehicle can hold; bounds the ground speed in a wind."""
    # Vertical speeds: never exceeded; the last one near the ground while landing.
    climb_speed_m_s: float = 4.0
    descent_speed_m_s: float = 3.0
    landing_speed_m_s: float = 0.7
    # Bounds on the horizontal acceleration and jerk vectors; 80 % of each is used along the path, the rest is
    # kept for corners (see docs/vehicle-model.md).
    acceleration_m_s2: float = 3.75
    jerk_m_s3: float = 5.0
    # Bounds on the vertical acceleration and jerk.
    vertical_acceleration_m_s2: float = 2.5
    vertical_jerk_m_s3: float = 5.0
    # Bounds on the turning of the heading.
    yaw_rate_rad_s: float = math.radians(60.0)
    yaw_acceleration_rad_s2: float = math.radians(120.0)
    acceptance_radius_m: float = 1.0
    """Distance at which a waypoint that sets none is passed."""
    # Default take-off height, least return altitude, and ceiling, all above home.
    takeoff_altitude_m: float = 10.0
    return_altitude_m: float = 15.0
    max_altitude_m: float = 500.0
    max_distance_m: float = 20_000.0
    """Farthest allowed position from home."""
    step_s: float = 0.02
    """Time step of the motion model."""
    disarm_delay_s: float = 2.0
    """Time from touch-down to disarming."""
    cell_m: float = FOOT_M
    """Length of one step of the ideal vehicle."""
    linear_drag_1_s: float | None = None
    """Drag of a multirotor per mass and airspeed; None is that of the autopilot's reference airframe."""
    attitude_response_s: float | None = None
    """Time constant of its tilt behind the autopilot's demand; None is that of the reference airframe."""
    battery: BatterySpec | None = None
    """None is an endless battery."""
    power: AnyPowerSpec | None = None
    """The one of its kind; None uses no energy."""
    airframe: Any = None
    """The one of its kind; None is a typical one."""
    return_margin_m: float = 0.0
    """Added to the distance from home on which a return altitude depends, because a return may begin farther
    away than planned. 0 in flight; `sim_vehicle.autopilot.with_return_margin` sets it to price a way home."""
    autopilot_parameters: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    """Per autopilot, the parameters for when it flies this vehicle, under their real names."""
    published: PublishedEndurance | None = None
    """The maker's endurance, to compare the model with."""
    description: str = ""
    """In a few words, for lists."""

    def __post_init__(self) -> None:
        for name, known in (("kind", kind_names()), ("autopilot", (*autopilot_names(), NO_AUTOPILOT))):
            value = getattr(self, name)
            if value not in known:
                msg = f"vehicle {self.name}: {name} {value!r} is not one of {', '.join(known)}"
                raise VehicleError(msg)
        positive(f"vehicle {self.name}", self, *(f.name for f in fields(self) if f.name not in _NO_LIMITS))
        within(
            f"vehicle {self.name}", self, ("linear_drag_1_s", 0.0, 10.0), ("attitude_response_s", 0.02, 10.0)
        )
        if not 0.0 <= self.disarm_delay_s < 3600.0:
            msg = f"vehicle {self.name}: disarm_delay_s {self.disarm_delay_s} is outside 0..3600"
            raise VehicleError(msg)
        if not self.return_margin_m >= 0.0:
            msg = f"vehicle {self.name}: return_margin_m {self.return_margin_m} must not be negative"
            raise VehicleError(msg)
        if self.battery is not None and self.power is None:
            msg = f"vehicle {self.name}: a battery needs a power model ([power])"
            raise VehicleError(msg)
        kind = self.vehicle_kind
        if self.power is not None and not isinstance(self.power, kind.power or ()):
            msg = f"vehicle {self.name}: {type(self.power).__name__} is no power model of kind {self.kind}"
            raise VehicleError(msg)
        if self.airframe is not None and not isinstance(self.airframe, kind.airframe or ()):
            msg = f"vehicle {self.name}: {type(self.airframe).__name__} is no airframe of kind {self.kind}"
            raise VehicleError(msg)

    @property
    def vehicle_kind(self) -> VehicleKind:
        """The facts of its kind."""
        return get_kind(self.kind)

    @property
    def is_ideal(self) -> bool:
        """Whether it is the paper's robot, without dynamics."""
        return self.vehicle_kind.movement is Movement.STEPS

    @property
    def drives(self) -> bool:
        """Whether it stays on the ground: it does not take off, and heights do not count."""
        return self.vehicle_kind.movement is Movement.DRIVES

    @property
    def circles(self) -> bool:
        """Whether it can only stay where it is by circling."""
        return self.vehicle_kind.movement is Movement.CIRCLES

    @property
    def hovers(self) -> bool:
        """Whether it flies and can stay anywhere."""
        return self.vehicle_kind.movement is Movement.HOVERS

    def reaches(self, height_m: float) -> bool:
        """Whether it may be sent to a height above home."""
        return self.drives or 0.0 < height_m <= self.max_altitude_m

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
