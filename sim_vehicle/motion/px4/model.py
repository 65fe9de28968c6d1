"""Motion model of a multirotor under PX4: the compiled autopilot, its parameters and its memory."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.airframe.navigation_errors import COLUMNS
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import State
from sim_vehicle.motion.compiled_motion import Dynamics
from sim_vehicle.motion.legs import KEEP, LegKind
from sim_vehicle.motion.model import MotionEvent, attitude_of
from sim_vehicle.motion.multirotor.kernel import LIMITS
from sim_vehicle.motion.multirotor.model import GENERIC, Multirotor
from sim_vehicle.motion.px4 import kernel
from sim_vehicle.motion.px4.kernel import Guide, Law, Leg

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim_vehicle.airframe.navigation_errors import EstimateErrors
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route
    from sim_vehicle.weather.wind import Wind

# Delay between the navigator's order to return and the mode change.
MODE_SWITCH_S = 0.2
# Time that the limited jerk adds to the braking time at the start of a hold.
BRAKE_DELAY_S = 0.6
_SAME_M = 1e-3
# Number of estimate errors that are drawn at a time.
_ERRORS = 1000


class Px4Multirotor(Multirotor):
    """Multirotor under PX4 that flies routes.

    The generic dynamics of `Multirotor` take over for commanded velocities (`steer`) and for falls.

    Parameters
    ----------
    law_of : callable
        Function that returns the constants of the control law, float64[LAW], for a vehicle's parameters.
    yaw_rad : float
        Heading at the start and after a return.
    """

    dynamics = Dynamics(
        kernel.advance, col.STATE, LIMITS, (("guide", kernel.GUIDE), ("_law", kernel.LAW), ("_errors", None))
    )

    def __init__(
        self,
        spec: VehicleSpec,
        law_of: Callable[[VehicleSpec], NDArray[np.float64]],
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        super().__init__(spec, wind, yaw_rad)
        self._law_of = law_of
        self._law = law_of(spec)
        self._radius_m = spec.acceptance_radius_m
        self._home_yaw_rad = yaw_rad
        self._guided = False
        self._estimate_errors: EstimateErrors | None = None
        self._errors: NDArray[np.float64] = np.zeros((1, COLUMNS))
        self.guide: NDArray[np.float64] = np.zeros(len(Guide))
        self.guide[Guide.HEADING] = self.state[State.HEADING]
        self.guide[Guide.CLOCK] = -1.0

    @property
    def _dynamics_now(self) -> Dynamics:
        return self.dynamics if self._guided else GENERIC

    def estimate_with(self, errors: EstimateErrors) -> None:
        """Add errors to the autopilot's estimate, from the first take-off on."""
        self._estimate_errors = errors

    @property
    def estimate_error(self) -> tuple[float, float, float, float]:
        """Present errors of the estimated height (m) and velocity to the east, north and up (m/s)."""
        if len(self._errors) == 1:
            return 0.0, 0.0, 0.0, 0.0
        since = self.step // col.GRID - int(self._errors.item(0, 0))
        self._draw_errors(since + 1)
        height, east, north, up = self._errors[since + 1, :4].tolist()
        return height, east, north, up

    @property
    def draws_errors(self) -> bool:
        """Whether the autopilot's estimate has errors."""
        return self._estimate_errors is not None

    def _draw_errors(self, count: int) -> None:
        """Draw estimate errors, so that at least `count` errors since the first take-off are available."""
        assert self._estimate_errors is not None
        if len(self._errors) <= count:
            drawn = self._estimate_errors.first(2 * count + _ERRORS)
            self._errors = np.concatenate((self._errors[:1], drawn))

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Place the vehicle in steady flight at time 0, with no energy used and no path flown."""
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        self.guide[:] = 0.0
        self._guided = False

    def fly(self, route: Route) -> None:
        """Begin a route under PX4 from the present position and motion."""
        legs, points = route.legs, route.points_m
        table = np.zeros((len(legs), len(Leg)))
        # PX4 has no curves, so the vehicle flies their chords as ordinary legs.
        kind = np.where(legs["kind"] == LegKind.ARC, int(LegKind.WAYPOINT), legs["kind"])
        table[:, Leg.X : Leg.BEFORE_X] = points
        table[1:, Leg.BEFORE_X : Leg.AFTER_X] = points[:-1]
        stops = legs["pause"] > 0.0
        stops[-1] = True
        stops[:-1] |= kind[1:] == LegKind.ORBIT
        ahead = np.vstack([points[1:], points[-1:]])
        table[:, Leg.AFTER_X : Leg.RADIUS] = np.where(
            stops[:, np.newaxis] | (kind >= LegKind.CLIMB)[:, np.newaxis], points, ahead
        )
        table[:, Leg.RADIUS] = np.where(legs["radius"] > 0.0, legs["radius"], self._radius_m)
        table[:, Leg.SPEED] = np.where(legs["speed"] > 0.0, legs["speed"], self.spec.cruise_speed_m_s)
        table[:, Leg.SPEED] = np.minimum(table[:, Leg.SPEED], self._law[Law.XY_VEL_MAX])
        table[:, Leg.HEADING] = legs["heading"]
        table[:, Leg.NEAR] = legs["near"]
        table[:, Leg.KIND] = kind
        table[:, Leg.PAUSE] = legs["pause"]
        table[:, Leg.TURN_RATE] = legs["turn"]
        table[:, Leg.CIRCLE] = legs["circle"]
        self._prepare_first_leg(table)
        before = self._place_before(table[0, Leg.X : Leg.BEFORE_X])
        rows = table.view(kernel.LEG)[:, 0]
        self._begin(rows)
        state, guide = self._records("state", col.STATE), self._records("guide", kernel.GUIDE)
        kernel.begin_leg(guide[0], rows[0], state[0])
        if table[0, Leg.KIND] < LegKind.CLIMB:
            table[0, Leg.BEFORE_X : Leg.AFTER_X] = before
        self._guided = True

    def _prepare_first_leg(self, table: NDArray[np.float64]) -> None:
        """Give the autopilot control, on the ground or from the generic dynamics; prepare the first leg."""
        g, state = self.guide, self.state
        kinds = table[:, Leg.KIND]
        if g[Guide.CLOCK] < 0.0 and state[State.POSITION_Z] <= 0.0:
            if kinds[0] != LegKind.LAND:
                g[Guide.CLOCK] = 0.0
                if self._estimate_errors is not None and len(self._errors) == 1:
                    self._errors = np.zeros((1, COLUMNS))
                    self._errors[0, 0] = -(-self.step // col.GRID)
                    self._draw_errors(_ERRORS)
            g[Guide.LAUNCH] = 1.0
            if (
                kinds[0] == LegKind.WAYPOINT
                and math.dist(table[0, : Leg.Z], state[: State.POSITION_Z]) < self._radius_m
            ):
                kinds[0] = LegKind.TAKEOFF
        elif not self._guided or self._leaves_setpoint(kinds[0]):
            self._adopt()
        first = 0
        if len(table) > 1 and kinds[0] == LegKind.STAY:
            # PX4 does not brake before it turns home, so this leg ends at once.
            table[0, Leg.X : Leg.BEFORE_X] = state[col.POSITION]
            table[0, Leg.RADIUS] = math.inf
            first = 1
        if kinds[first] == LegKind.CLIMB:
            table[first, : Leg.Z] = (
                state[: State.POSITION_Z] + MODE_SWITCH_S * state[State.VELOCITY_X : State.VELOCITY_Z]
            )
        if (kinds == LegKind.HOME).any() and kinds[-1] == LegKind.LAND:
            table[-1, Leg.HEADING] = self._home_yaw_rad % (2.0 * math.pi)

    def _leaves_setpoint(self, kind: float) -> bool:
        """Whether the trajectory must restart because the last leg, a setpoint, had no trajectory."""
        old = self._route
        return old is not None and kind != LegKind.SETPOINT and old["kind"][self.leg] == LegKind.SETPOINT

    def _adopt(self) -> None:
        """Initialise the trajectory and the controllers from the motion of a vehicle in flight."""
        g, state = self.guide, self.state
        g[Guide.X : Guide.INTEGRAL_X] = state[State.POSITION_X : State.HEADING]
        g[Guide.ERROR : Guide.PUSH_X] = self.estimate_error
        g[Guide.Z] += g[Guide.ERROR]
        g[Guide.VX : Guide.AX] += g[Guide.ERROR_VX : Guide.PUSH_X]
        thrust = state[col.ACCELERATION] + self._law[Law.DRAG] * (
            state[col.VELOCITY] - (state[State.WIND_EAST], state[State.WIND_NORTH], 0.0)
        )
        g[Guide.INTEGRAL_X : Guide.INTEGRAL_Z] = (
            thrust[:2] - state[State.ACCELERATION_X : State.ACCELERATION_Z]
        )
        g[Guide.INTEGRAL_Z] = 0.0
        thrust[2] += GRAVITY_M_S2
        g[Guide.THRUST] = max(math.sqrt((thrust * thrust).sum()), 1e-3)
        g[Guide.THRUST_X : Guide.THRUST_RATE_X] = thrust[:2] / g[Guide.THRUST]
        g[Guide.THRUST_RATE_X : Guide.THRUST] = 0.0
        g[Guide.FILTERED_AX : Guide.TURN] = state[col.ACCELERATION]
        g[Guide.TURN] = g[Guide.CLIMB] = 0.0
        g[Guide.CLOCK] = math.inf
        g[Guide.HEADING] = state[State.HEADING]

    def _place_before(self, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the start of the first leg of a new route: the previous waypoint or the present position."""
        leg = self.leg
        if self._route is not None and self._guided:
            old: NDArray[np.float64] = self._route.view(np.float64).reshape(-1, len(Leg))
            if np.abs(old[leg, Leg.X : Leg.BEFORE_X] - target).max() < _SAME_M and self.arrivals[leg] < 0:
                return old[leg, Leg.BEFORE_X : Leg.AFTER_X].copy()
            if self.arrivals[leg] >= 0:
                return old[leg, Leg.X : Leg.BEFORE_X].copy()
            if leg > 0 and self.arrivals[leg - 1] == self.counters[col.STEP]:
                return old[leg - 1, Leg.X : Leg.BEFORE_X].copy()
        here: NDArray[np.float64] = self.state[col.POSITION].copy()
        here[2] += self.guide[Guide.ERROR]
        return here

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Keep a velocity, or its horizontal part at a fixed altitude; a descent ends on the ground."""
        self._leave()
        super().steer(velocity_m_s, height_m=height_m, heading=heading)

    def _leave(self) -> None:
        """Give control to the generic dynamics, and clip the acceleration to their limits."""
        if self._guided:
            size = math.hypot(self.state[State.ACCELERATION_X], self.state[State.ACCELERATION_Y])
            if size > self.spec.acceleration_m_s2:
                self.state[State.ACCELERATION_X : State.ACCELERATION_Z] *= self.spec.acceleration_m_s2 / size
            most = self.spec.vertical_acceleration_m_s2
            self.state[State.ACCELERATION_Z] = min(max(self.state[State.ACCELERATION_Z], -most), most)
        self._guided = False

    def stopping_point(self) -> Position:
        """Return the position that PX4 would hold if it were ordered to hold now."""
        x, y, z, vx, vy = self.state[State.POSITION_X : State.VELOCITY_Z].tolist()
        z += float(self.guide[Guide.ERROR])
        speed = math.hypot(vx, vy)
        if speed < 1e-3:
            return x, y, max(z, 0.0)
        time_s = 0.5 * speed / self._law[Law.ACC_HOR] + BRAKE_DELAY_S
        return x + vx * time_s, y + vy * time_s, max(z, 0.0)

    def attitude(self) -> tuple[float, float, float, float] | None:
        """Return roll, pitch, airspeed and throttle, or None if the acceleration determines them."""
        if not self._guided or self.state[State.POSITION_Z] <= 0.0:
            return None
        # These become Python floats, because arithmetic with array elements takes three times as long.
        east, north, _, _, thrust = self.guide[Guide.THRUST_X : Guide.THRUST + 1].tolist()
        up = math.sqrt(1.0 - east * east - north * north)
        roll, pitch = attitude_of(east, north, up, self.state.item(State.HEADING))
        return roll, pitch, self._airspeed, min(thrust / kernel.SIH_THRUST_M_S2, 1.0)

    def advance(self, max_steps: int, *, stop_each: bool = True) -> MotionEvent:
        """Fly for ``max_steps`` steps, or until an event occurs (see `MotionEvent`)."""
        if not self._guided or len(self._errors) == 1:
            return super().advance(max_steps, stop_each=stop_each)
        # Estimate errors must be drawn before the kernel uses them.
        step = self.step
        end = step + max_steps
        event = MotionEvent.RAN
        while event is MotionEvent.RAN and step < end:
            steps = min(end - step, _ERRORS * col.GRID)
            self._draw_errors((step + steps) // col.GRID - int(self._errors.item(0, 0)) + 2)
            event = self._run(self.dynamics, steps, stop_each)
            step = self.step
        return event

    def update_spec(self, spec: VehicleSpec) -> None:
        """Replace the vehicle's defaults and limits."""
        super().update_spec(spec)
        self._law = self._law_of(spec)
        self._radius_m = spec.acceptance_radius_m

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Limit the climb and descent speeds; None selects the vehicle's limit."""
        super().set_climb(climb_m_s, descent_m_s)
        law = self._law_of(self.spec)
        for index, speed in ((Law.AUTO_UP, climb_m_s), (Law.AUTO_DOWN, descent_m_s)):
            self._law[index] = min(speed or math.inf, law[index])

    def touch_down(self) -> None:
        """Put the vehicle and PX4's memory at rest on the ground."""
        super().touch_down()
        self.guide[:] = 0.0
        self.guide[Guide.HEADING] = self.state[State.HEADING]
        self.guide[Guide.CLOCK] = -1.0
        self._guided = False
