"""Motion models under ArduPilot: vehicles along S-curves, and the multirotor under ArduCopter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sim_vehicle.airframe.power_spec import CONSTANT_POWER, GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter import control as at
from sim_vehicle.motion.arducopter import kernel, scurve
from sim_vehicle.motion.arducopter.control import Guide, Law, Leg, stopping_distance
from sim_vehicle.motion.columns import State
from sim_vehicle.motion.compiled_motion import CompiledMotion, Dynamics
from sim_vehicle.motion.legs import KEEP, LegKind
from sim_vehicle.motion.model import attitude_of
from sim_vehicle.motion.multirotor.kernel import LIMITS
from sim_vehicle.motion.multirotor.model import GENERIC, Multirotor

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.columns import Record
    from sim_vehicle.motion.legs import Heading, Position, Route
    from sim_vehicle.weather.wind import Wind

    Floats = NDArray[np.float64]

# A vehicle placed in flight joins its first leg if at least this fraction of its speed points along the leg.
# The leg began at most `_FAR_M` behind the vehicle; the leg's profile may be faster by `_SAME_M_S`.
_STEADY = 0.2
_FAR_M = 200.0
_SAME_M_S = 0.3
# Number of bisections that find a time; 24 bisections find it to 6 us on a leg of 100 s.
_HALVINGS = 24
# Indices into the result of `scurve.state_at`.
_POSITION, _SPEED = 0, 1
# Delay from arming until ArduCopter's motors spool up (ARMING_DELAY_SEC).
_ARMING_DELAY_S = 2.0


class AlongCurves(CompiledMotion):
    """Vehicle that ArduPilot guides along S-curves; the generic dynamics fly the commanded velocities."""

    generic: ClassVar[Dynamics]
    """Dynamics of the same vehicle without an autopilot."""
    begins_anew: ClassVar[LegKind]
    """Kind of leg that never continues the previous leg."""

    def _remember(self, columns: int) -> None:
        """Make an empty guidance memory; its array `guide` has `columns` elements."""
        self.guide: NDArray[np.float64] = np.zeros(columns)
        self.heads: NDArray[np.float64] = np.zeros((3, scurve.HEAD))
        self.curves: NDArray[np.float64] = np.zeros((3, scurve.SEGMENTS, scurve.COLUMNS))
        self._rows: Record | None = None
        self._under_way = self._interrupted = False

    @property
    def _dynamics_now(self) -> Dynamics:
        return self.generic if self._rows is None else self.dynamics

    def interrupt(self) -> None:
        """Abort the present leg; as in AC_WPNav, the next leg starts at the stopping point."""
        self._interrupted = True

    @property
    def _continues_leg(self) -> bool:
        """Whether the vehicle was placed in flight on a leg that began behind the vehicle."""
        return self._under_way and not self._interrupted

    def _set_out(
        self, route: Route, law: Floats, points_m: Floats, kind: NDArray[Any], fastest: float
    ) -> None:
        """Begin a route; the caller has chosen the legs' ends and kinds and the top speed.

        Parameters
        ----------
        law : float64[LAW]
        """
        legs = route.legs
        speed = np.where(np.isnan(legs["speed"]), 0.0, np.minimum(legs["speed"], fastest))
        rest = (legs["heading"], legs["near"], kind, legs["pause"], legs["turn"])
        rows = np.column_stack((points_m, legs["radius"], speed, *rest))
        under_way, self._under_way = self._continues_leg, False
        self.guide[Guide.BEGINS] = self._join(rows[0], law) if under_way else self._follows(rows[0])
        self._rows = np.ascontiguousarray(rows).view(at.LEG)[:, 0]
        self._begin(self._rows)

    def _join(self, row: Floats, law: Floats) -> int:
        """Place the vehicle in the middle of a leg, and return the transition to this leg."""
        guide, head, curve = self.guide, self.heads[1], self.curves[1]
        here, velocity = self.state[col.POSITION], self.state[col.VELOCITY]
        end = row[: Leg.Z + 1]
        left = math.sqrt(((end - here) ** 2).sum())
        speed = math.sqrt((velocity**2).sum())
        along = float((velocity * (end - here)).sum()) / left if left > 0.0 else 0.0
        if int(row[Leg.KIND]) not in (LegKind.WAYPOINT, LegKind.HOME) or along < _STEADY * max(speed, 0.5):
            return at.ANEW
        guide[Guide.LEVEL] = row[Leg.SPEED] if row[Leg.SPEED] >= at.LEAST_SPEED else guide[Guide.LEVEL]
        guide[Guide.UP], guide[Guide.DOWN] = law[Law.SPEED_UP], law[Law.SPEED_DOWN]
        ahead = (end - here) / left
        _make_leg(guide, law, head, curve, ahead * (_FAR_M + left))
        at_s = _time_of(head, curve, _POSITION, _FAR_M, scurve.end_time(head, curve))
        behind = _FAR_M
        if scurve.state_at(head, curve, at_s)[1] > along + _SAME_M_S:
            # The vehicle is still accelerating, so the leg began where the profile was still at rest.
            at_s = _time_of(head, curve, _SPEED, along, 0.5 * scurve.end_time(head, curve))
            behind = scurve.state_at(head, curve, at_s)[0]
            _make_leg(guide, law, head, curve, ahead * (behind + left))
            at_s = _time_of(head, curve, _POSITION, behind, scurve.end_time(head, curve))
        _, speed, acceleration = scurve.state_at(head, curve, at_s)
        head[scurve.TIME] = at_s
        guide[Guide.BEGIN_X : Guide.BEGIN_X + 3] = here - ahead * behind
        guide[Guide.END_X : Guide.END_X + 3] = end
        guide[Guide.PX : Guide.PX + 3] = here
        guide[Guide.VX : Guide.VX + 3] = ahead * speed
        guide[Guide.AX : Guide.AX + 3] = ahead * acceleration
        guide[Guide.MODE] = at.LEGS
        guide[Guide.RESET] = guide[Guide.PACE] = 1.0
        return at.SAME

    def _follows(self, row: Floats) -> int:
        """Return the transition from the present leg to the leg `row`."""
        interrupted, self._interrupted = self._interrupted, False
        if self._rows is None or row[Leg.KIND] == self.begins_anew:
            return at.ANEW
        guide, target, arrived = self.guide, row[: Leg.Z + 1], bool(self.counters[col.ARRIVED])
        chained = guide[Guide.BEGINS] == at.CHAINED
        if interrupted and not (chained or arrived):
            return at.ANEW
        end = guide[Guide.END_X : Guide.END_X + 3]
        if chained and guide[Guide.FAST] != 0.0:
            head = self.heads[2]
            ahead = end + head[scurve.LENGTH] * head[scurve.UX : scurve.UZ + 1]
            return at.CHAINED if np.allclose(ahead, target, rtol=0.0, atol=1e-3) else at.ANEW
        if chained or arrived:
            return at.CHAINED
        if guide[Guide.MODE] == at.LEGS and np.allclose(end, target, rtol=0.0, atol=1e-3):
            return at.SAME
        return at.ANEW


def _make_leg(guide: Floats, law: Floats, head: Floats, curve: Floats, way: Floats) -> None:
    """Make the profile of a leg at the present speed limits."""
    east, north, up = way.tolist()
    scurve.make_leg(
        head,
        curve,
        (east, north, up),
        (float(guide[Guide.LEVEL]), float(guide[Guide.UP]), float(guide[Guide.DOWN])),
        (float(law[Law.ACCEL]), float(law[Law.ACCEL_Z])),
        law[Law.SNAP],
        law[Law.JERK],
    )


def _time_of(head: Floats, curve: Floats, which: int, value: float, end_s: float) -> float:
    """Return the time at which the rising position or speed of the profile reaches `value`."""
    low, high = 0.0, end_s
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if scurve.state_at(head, curve, middle)[which] < value:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


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
        """Begin a route under ArduCopter from the present position and motion."""
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
        """Put the vehicle and ArduCopter's guidance at rest on the ground."""
        super().touch_down()
        # After a landing, the arming delay counts as over until the vehicle disarms.
        self._armed_steps = round(_ARMING_DELAY_S / self.step_s)
        self._rows = None
        self.guide[:] = 0.0
        self.guide[Guide.LEVEL] = self.spec.cruise_speed_m_s
