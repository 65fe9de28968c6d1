"""Flight procedures of a fixed wing's autopilot: motion, take-off, approach."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.procedures import FixedWingProcedures
from sim_vehicle.motion.legs import KEEP, Circle, Heading, Leg, LegKind, Position

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind
    from wbf_mission.addons.wings.motion.layout import FixedWingLimits

# Accelerations of a thrown or catapulted take-off and of a ground roll; airspeed of a throw as a fraction of
# the minimum airspeed.
_THROW_M_S2, _ROLL_M_S2, _THROW_SHARE = 20.0, 3.0, 0.85
# A landing closer than this has no approach direction.
_APPROACH_M = 30.0


class WingProcedures(FixedWingProcedures):
    """Procedures of a fixed wing's firmware: compiled motion and approach."""

    return_kind: str
    """Parameter with the value 1 or 2 if a return flies the mission's landing."""

    @abstractmethod
    def limits(self, spec: VehicleSpec) -> FixedWingLimits:
        """Return the flight limits of a vehicle."""

    def start_of_flight(self, spec: VehicleSpec, rotation: float, least: float) -> tuple[float, float]:
        """Return the airspeed of lift-off, and the acceleration until then (0: set by the thrust).

        `rotation` is the lift-off airspeed on a runway (0: no runway). `least` is the minimum airspeed.
        """
        lifts_off = None if spec.airframe is None else spec.airframe.liftoff_airspeed_m_s
        if lifts_off is not None:
            return max(lifts_off, rotation), 0.0
        return (rotation, _ROLL_M_S2) if rotation > 0.0 else (_THROW_SHARE * least, _THROW_M_S2)

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with the values that its parameters set."""
        limits = self.limits(spec)
        return replace(
            spec,
            cruise_speed_m_s=limits.airspeed_trim,
            speed_limit_m_s=limits.airspeed_max / 0.95,
            airspeed_limit_m_s=limits.airspeed_max,
            climb_speed_m_s=limits.climb_max,
            descent_speed_m_s=limits.sink_max,
            landing_speed_m_s=max(limits.flare_sink, 0.1),
            acceptance_radius_m=limits.acceptance,
            takeoff_altitude_m=max(self.value(spec, self.takeoff_height), 1.0),
            return_altitude_m=max(self.value(spec, self.return_height), 1.0),
        )

    def lands_as_mission(self, spec: VehicleSpec) -> bool:
        """Return whether a return ends with the landing of the mission, if the mission has a landing."""
        return self.value(spec, self.return_kind) in (1.0, 2.0)

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle at rest at home."""
        from wbf_mission.addons.wings.motion.model import FixedWing

        return FixedWing(spec, self.limits, wind, yaw_rad)

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return the climb-out to the take-off height."""
        x, y, _ = here if self.climbs_ahead else target
        return [Leg((x, y, max(target[2], 0.5)), speed, heading=KEEP, kind=LegKind.TAKEOFF)]

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return a straight approach from `last`, or a circle down to the ground if `last` is too close."""
        x, y, z = above
        landing = self.limits(spec).landing_airspeed
        if math.hypot(x - last[0], y - last[1]) >= _APPROACH_M:
            return [Leg((x, y, 0.0), landing, kind=LegKind.LAND)]
        return [
            Leg((x, y, z), spec.cruise_speed_m_s, heading=KEEP, kind=LegKind.LOITER, circle=Circle()),
            Leg((x, y, 0.0), landing, heading=KEEP, kind=LegKind.LAND, circle=Circle()),
        ]


def airspeeds_in_order(least: float, trim: float, most: float) -> tuple[float, float, float]:
    """Return the airspeeds in order; the trim airspeed is at least 3 m/s and bounds the other two."""
    trim = max(trim, 3.0)
    return min(least, trim), trim, max(most, trim)
