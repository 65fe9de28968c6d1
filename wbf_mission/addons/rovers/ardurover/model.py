"""Motion model of a ground vehicle under ArduPilot's Rover, with the compiled kernel."""

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

# Legs followed by pure pursuit: bends of a curve, and repeated position setpoints, for which ArduPilot's
# Rover uses no S-curves either.
_PURSUED = (LegKind.ARC, LegKind.SETPOINT)


class ArduRover(AlongCurves, Rover):
    """A wheeled or tracked vehicle under ArduPilot's Rover; velocity setpoints are followed as by `Rover`.

    Parameters
    ----------
    limits_of, law_of : callable
        Functions from a vehicle to its limits and its law, float64[LAW], from its parameters.
    wind : Wind, optional
        Affects only the power.
    yaw_rad : float
        Initial heading.
    """

    dynamics = Dynamics(
        kernel.advance,
        wheels.STATE,
        wheels.LIMITS,
        (("guide", kernel.GUIDE), ("numbers", kernel.LAW), ("heads", None), ("curves", None)),
        "_rows",
    )
    generic = Rover.dynamics
    # A return starts from the stop of the vehicle.
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
        """Reset the guidance: no path, at the vehicle's speed."""
        self._rows = None
        self.guide[:] = 0.0
        self.guide[Guide.LEVEL] = self.spec.cruise_speed_m_s
        self.guide[Guide.RESET] = 1.0
        self.guide[Drive.SPEED_ASKED] = self.state[Wheels.SPEED]

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Start in motion at time 0, with nothing used, as if driven there.

        If the first leg lies ahead, its speed profile starts at the vehicle's speed.
        """
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        self.heads[:] = 0.0
        self._rest()
        self._under_way = True

    def fly(self, route: Route) -> None:
        """Start a route from the vehicle's current position and speed."""
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
        """Drive at a velocity, or stop; a command to descend stops the vehicle for good."""
        self._rest()
        super().steer(velocity_m_s, height_m=height_m, heading=heading)

    def lose_power(self) -> None:
        """Stop, as the motor has no power."""
        super().lose_power()
        self.numbers[DriveLaw.TOP_SPEED] = 0.0

    def update_spec(self, spec: VehicleSpec) -> None:
        """Change defaults and limits, effective from the next route on."""
        super().update_spec(spec)
        self.numbers = self._law_of(spec)

    def touch_down(self) -> None:
        """Set the vehicle to rest."""
        super().touch_down()
        self._rest()
