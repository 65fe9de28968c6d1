"""Motion model of a multirotor under ArduCopter: the compiled kernel, its state and its control law."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.airframe.power_spec import CONSTANT_POWER, GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter import control as at
from sim_vehicle.motion.arducopter import kernel
from sim_vehicle.motion.arducopter.along_curves import AlongCurves
from sim_vehicle.motion.arducopter.control import Guide, Law, stopping_distance
from sim_vehicle.motion.columns import State
from sim_vehicle.motion.compiled_motion import Dynamics
from sim_vehicle.motion.legs import KEEP, LegKind
from sim_vehicle.motion.model import attitude_of
from sim_vehicle.motion.multirotor.kernel import LIMITS
from sim_vehicle.motion.multirotor.model import GENERIC, Multirotor

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route
    from sim_vehicle.weather.wind import Wind

# Delay from arming until ArduCopter's motors spool up (ARMING_DELAY_SEC).
_ARMING_DELAY_S = 2.0


class ArduCopter(AlongCurves, Multirotor):
    """Multirotor under ArduCopter; the generic dynamics of `Multirotor` fly commanded velocities.

    Parameters
    ----------
    law_of : callable
        Function that returns the constants of the control law, float64[LAW], for a vehicle's parameters.
    yaw_rad : float
        Heading at the start.

    Examples
    --------
    >>> from sim_vehicle.autopilot import flight_procedures, with_autopilot
    >>> from sim_vehicle.motion.legs import Leg, Route
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> spec = with_autopilot(get_vehicle("quad"), "ardupilot")
    >>> vehicle = flight_procedures(spec).motion(spec, None, 0.0)
    >>> vehicle.fly(Route.through([Leg((0.0, 0.0, 10.0), 5.0, heading=KEEP, kind=LegKind.TAKEOFF)]))
    >>> vehicle.advance(10_000)
    <MotionEvent.REACHED: 1>
    >>> round(vehicle.position_m[2]), 6.0 < vehicle.time_s < 12.0
    (10, True)
    """

    dynamics = Dynamics(
        kernel.advance,
        col.STATE,
        LIMITS,
        (("guide", at.GUIDE), ("law", at.LAW), ("heads", None), ("curves", None)),
        "_rows",
    )
    generic = GENERIC
    begins_anew = LegKind.CLIMB

    def __init__(
        self,
        spec: VehicleSpec,
        law_of: Callable[[VehicleSpec], NDArray[np.float64]],
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        super().__init__(spec, wind, yaw_rad)
        self._remember(len(Guide))
        self._law_of = law_of
        self._take_law()
        self.guide[Guide.LEVEL] = spec.cruise_speed_m_s
        self._armed_steps = 0

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Place the vehicle in steady flight at time 0, with no energy used and no path flown.

        If the first leg lies ahead, the vehicle joins it where the leg's profile has the present speed.
        """
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        guide, law = self.guide, self.law
        guide[:] = 0.0
        guide[Guide.LEVEL] = self.spec.cruise_speed_m_s
        self.heads[:] = 0.0
        # These values of attitude and integrators balance the drag.
        air = self.state[col.VELOCITY][:2] - self.state[col.LEVEL_WIND]
        lean = (law[Law.DRAG] + law[Law.DRAG_2] * float(np.hypot(*air))) * air
        for first in (Guide.INTEGRAL_X, Guide.ASKED_X, Guide.TARGET_X, Guide.LEAN_X):
            guide[first : first + 2] = lean
        self._rows = None
        self._under_way, self._interrupted = True, False

    def fly(self, route: Route) -> None:
        """Begin a route from the present position and motion."""
        fastest = self.spec.top_speed_m_s
        self.guide[Guide.ARMING_STEPS] = max(round(_ARMING_DELAY_S / self.step_s) - self._armed_steps, 0)
        self._set_out(route, self.law, route.points_m, route.legs["kind"], fastest)

    def rest(self, steps: int, *, armed: bool) -> None:
        """Stand on the ground for a number of steps; armed steps count towards the delay before spool-up."""
        super().rest(steps, armed=armed)
        self._armed_steps = self._armed_steps + steps if armed else 0

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Keep a velocity, or its horizontal part at an altitude; a descent ends on the ground."""
        self._rows = None
        super().steer(velocity_m_s, height_m=height_m, heading=heading)

    def point(self, heading_rad: float) -> None:
        """Turn the nose to a compass heading on the present leg."""
        if self._rows is None:
            super().point(heading_rad)
            return
        self._rows["heading"][self.leg] = heading_rad
        self._rows["turning"][self.leg] = math.nan

    def stopping_point(self) -> Position:
        """Return the position at which the vehicle stops if it brakes now."""
        x, y, z, vx, vy, vz = self.state[State.POSITION_X : State.ACCELERATION_X].tolist()
        law, guide = self.law, self.guide
        speed = math.hypot(vx, vy)
        if speed > 0.0:
            most = min(speed, float(guide[Guide.LEVEL]))
            seconds = stopping_distance(most, law[Law.POS_P], law[Law.ACCEL]) / speed
            x, y = x + vx * seconds, y + vy * seconds
        most = float(law[Law.SPEED_UP if vz > 0.0 else Law.SPEED_DOWN])
        distance = stopping_distance(min(abs(vz), most), law[Law.POS_Z_P], law[Law.ACCEL_Z])
        return x, y, max(z + math.copysign(distance, vz), 0.0)

    def attitude(self) -> tuple[float, float, float, float] | None:
        """Return roll, pitch, airspeed and throttle, or None if the acceleration determines them."""
        if self._rows is None or self.state[State.POSITION_Z] <= 0.0:
            return None
        east, north = self.guide[Guide.LEAN_X : Guide.LEAN_X + 2].tolist()
        roll, pitch = attitude_of(east, north, GRAVITY_M_S2, self.state.item(State.HEADING))
        stretch = math.sqrt(1.0 + (east * east + north * north) / GRAVITY_M_S2**2)
        thrust = (1.0 + float(self.guide[Guide.THRUST]) / GRAVITY_M_S2) * stretch
        return roll, pitch, self._airspeed, min(max(at.HOVER_THROTTLE * thrust, 0.0), 1.0)

    def update_spec(self, spec: VehicleSpec) -> None:
        """Replace the vehicle's defaults, limits and parameters; the new values apply from the next leg."""
        super().update_spec(spec)
        self._take_law()

    def _take_law(self) -> None:
        self.law = self._law_of(self.spec)
        self.law[Law.STAND_BY] = self._idle_w + float(self._power[CONSTANT_POWER])

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Set the climb and descent speeds from the next route on; None selects the vehicle's default."""
        super().set_climb(climb_m_s, descent_m_s)
        self.law[Law.SPEED_UP] = climb_m_s or self.spec.climb_speed_m_s
        self.law[Law.SPEED_DOWN] = descent_m_s or self.spec.descent_speed_m_s

    def touch_down(self) -> None:
        """Stand still on the ground."""
        super().touch_down()
        # After a landing, the arming delay counts as over until the vehicle disarms.
        self._armed_steps = round(_ARMING_DELAY_S / self.step_s)
        self._rows = None
        self.guide[:] = 0.0
        self.guide[Guide.LEVEL] = self.spec.cruise_speed_m_s
