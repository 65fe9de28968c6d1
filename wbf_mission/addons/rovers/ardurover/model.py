"""A ground vehicle as ArduPilot's Rover drives it: the compiled drive with its state and its law."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.motion.arducopter.along_curves import AlongCurves
from sim_vehicle.motion.arducopter.control import Guide
from sim_vehicle.motion.compiled_motion import Dynamics
from sim_vehicle.motion.legs import KEEP, LegKind
from wbf_mission.addons.rovers.ardurover import kernel
from wbf_mission.addons.rovers.ardurover.kernel import Drive, DriveLaw
from wbf_mission.addons.rovers.motion import layout as wheels
from wbf_mission.addons.rovers.motion.layout import Wheels
from wbf_mission.addons.rovers.motion.model import NOT_DRIVEN, Rover

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route
    from sim_vehicle.weather.wind import Wind
    from wbf_mission.addons.rovers.motion.layout import RoverLimits

# Legs that are followed as by any `Rover`: bends of a curve, and repeated position setpoints, to which
# ArduPilot's Rover does not drive along S-curves either.
_PURSUED = (LegKind.ARC, LegKind.SETPOINT)


class ArduRover(AlongCurves, Rover):
    """A vehicle on wheels or tracks under ArduPilot's Rover; velocities are driven as any `Rover` does.

    Parameters
    ----------
    limits_of, law_of : callable
        What the autopilot makes of a vehicle's parameters: limits, and float64[LAW].
    wind : Wind, optional
        Counts only in the power.
    yaw_rad : float
        Heading at the start.
    """

    dynamics = Dynamics(
        kernel.advance,
        wheels.STATE,
        wheels.LIMITS,
        (("guide", kernel.GUIDE), ("numbers", kernel.LAW), ("heads", None), ("curves", None)),
        "_rows",
    )
    generic = Rover.dynamics
    # A return begins anew from where the vehicle stops.
    begins_anew = LegKind.HOME

    def __init__(
        self,
        spec: VehicleSpec,
        limits_of: Callable[[VehicleSpec], RoverLimits],
        law_of: Callable[[VehicleSpec], NDArray[np.float64]],
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        super().__init__(spec, limits_of, wind, yaw_rad)
        self._law_of = law_of
        self._remember(len(Guide) + len(Drive))
        self.numbers = law_of(spec)
        self._rest()

    def _rest(self) -> None:
        """Begin without a path, at the vehicle's speed."""
        self._rows = None
        self.guide[:] = 0.0
        self.guide[Guide.LEVEL] = self.spec.cruise_speed_m_s
        self.guide[Guide.RESET] = 1.0
        self.guide[Drive.SPEED_ASKED] = self.state[Wheels.SPEED]

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Be under way at time 0, with nothing used yet, as if it had driven there.

        A first leg that lies ahead goes on from the point of its profile at which it has that speed.
        """
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        self.heads[:] = 0.0
        self._rest()
        self._under_way = True

    def fly(self, route: Route) -> None:
        """Begin a route, from where the vehicle is and as it moves now."""
        kind = route.legs["kind"]
        if np.isin(kind, _PURSUED).any():
            self._rest()
            super().fly(route)
            return
        if self._rows is None and not self._continues_leg:
            self._rest()
        ends = np.column_stack((route.points_m[:, :2], np.zeros(len(kind))))
        kind = np.where(np.isin(kind, NOT_DRIVEN), kernel.AT_ONCE, kind)
        self._set_out(route, self.numbers, ends, kind, self.law.speed_max)

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Drive at a velocity, or stop; an order to go down stops it for good."""
        self._rest()
        super().steer(velocity_m_s, height_m=height_m, heading=heading)

    def lose_power(self) -> None:
        """Stop: without power it cannot go anywhere."""
        super().lose_power()
        self.numbers[DriveLaw.TOP_SPEED] = 0.0

    def update_spec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits; they hold from the next route on."""
        super().update_spec(spec)
        self.numbers = self._law_of(spec)

    def touch_down(self) -> None:
        """Stand still."""
        super().touch_down()
        self._rest()
