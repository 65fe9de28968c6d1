"""Executor of one vehicle's orders and mission; it simulates without MAVLink and without a clock."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_vehicle.autopilot import fixed_wing_procedures, flight_procedures
from sim_vehicle.energy.battery import remaining_fraction
from sim_vehicle.execution.item_legs import circle_leg, lands, orbit_legs
from sim_vehicle.execution.items import MAX_TURNS
from sim_vehicle.execution.leg_follower import AfterLastLeg, LegFollower, require
from sim_vehicle.execution.sequencer import MissionSequencer
from sim_vehicle.execution.state import EPOCH_UNIX_S, FlightEvent, FlightPhase, LandedState, VehicleState
from sim_vehicle.motion.legs import ALONG, INWARD, KEEP, Heading, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Generator

    from geo.frame import LocalFrame
    from sim_vehicle.airframe.navigation_errors import EstimateErrors
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position
    from sim_vehicle.motion.model import MotionEvent, MotionModel
    from sim_vehicle.weather.wind import Wind

# Shortest stopping distance for which a return begins with a braking leg.
_BRAKING_M = 0.2


class MissionExecutor:
    """Executor of one simulated vehicle; `mission` turns mission items into legs, which `flight` flies.

    Call ``mission.load(items)``, ``arm()`` and ``start()``, then ``advance(until_s)`` repeatedly. An order
    takes effect at the time of the last `advance`; an order that the vehicle cannot obey raises VehicleError.

    Parameters
    ----------
    frame : LocalFrame
        Local frame with its origin at home; ``altitude_m`` is the ground elevation at home (m AMSL).
    wind : Wind, optional
        Wind field; the ideal vehicle ignores wind.
    yaw_rad : float
        Compass heading at the start.
    takes_off, epoch_unix_s
        See `sim_vehicle.execution.sequencer.MissionSequencer`.
    estimate_errors : EstimateErrors, optional
        Errors of the autopilot's position estimate; without them the estimate is exact.
    """

    def __init__(
        self,
        spec: VehicleSpec,
        frame: LocalFrame,
        *,
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
        takes_off: bool = False,
        epoch_unix_s: float = EPOCH_UNIX_S,
        estimate_errors: EstimateErrors | None = None,
    ) -> None:
        self.flight = LegFollower(spec, wind=wind, yaw_rad=yaw_rad)
        if estimate_errors is not None:
            self.motion.estimate_with(estimate_errors)
        self.mission = MissionSequencer(self.flight, frame, takes_off=takes_off, epoch_unix_s=epoch_unix_s)

    @property
    def spec(self) -> VehicleSpec:
        """Vehicle specification with the defaults and limits now in force."""
        return self.flight.spec

    @property
    def motion(self) -> MotionModel:
        """Motion model of the vehicle."""
        return self.flight.motion

    @property
    def time_s(self) -> float:
        """Simulated time (s); it is a multiple of the time step."""
        return self.flight.time_s

    def update_spec(self, spec: VehicleSpec) -> None:
        """Replace defaults and limits; the new values apply from the next leg or order."""
        same = spec.kind == self.spec.kind and spec.step_s == self.spec.step_s
        require(same, f"vehicle {spec.name}: the kind and the time step cannot change in flight")
        settings = self.mission.settings
        if settings.speed_m_s == self.spec.cruise_speed_m_s:
            settings.speed_m_s = spec.cruise_speed_m_s
        self.flight.spec = spec
        self.motion.update_spec(spec)

    def arm(self) -> None:
        """Start the motors."""
        battery = self.spec.battery
        empty = battery is not None and remaining_fraction(battery, self.motion.energy_j) <= 0.0
        require(not empty, "the battery is empty: change it before arming")
        self.flight.armed = True
        self.flight.disarm_step = None

    def disarm(self, *, force: bool = False) -> None:
        """Stop the motors. With `force`, a vehicle in the air is put on the ground at once."""
        if self.flight.landed is not LandedState.ON_GROUND:
            require(force, "cannot disarm in flight: land first, or force it")
            self.flight.touch_down()
        self.flight.stop_motors()

    def stay_armed(self) -> None:
        """Cancel automatic disarming after a touch-down, until the next order."""
        if self.flight.landed is LandedState.ON_GROUND and not self.flight.phase.is_lost:
            self.flight.disarm_step = None

    def start(self) -> None:
        """Begin the mission at the current item, or resume it there."""
        self.flight.ready("start the mission")
        require(bool(self.mission.items), "cannot start the mission: none is loaded")
        self.mission.begin_at(self.mission.current_seq)

    def takeoff(self, altitude_m: float) -> None:
        """Climb to `altitude_m` above the start and hold there; emit TargetReached on arrival."""
        self.flight.ready("take off")
        require(not self.spec.drives, f"cannot take off: a {self.spec.kind} stays on the ground")
        self._check_height(altitude_m)
        x, y, z = self.motion.position_m
        self.flight.disarm_step = None
        self.mission.settings.speed_m_s = speed = self.spec.cruise_speed_m_s
        climb = Leg((x, y, max(altitude_m, z)), speed, heading=KEEP, kind=LegKind.TAKEOFF)
        self.flight.fly([climb], FlightPhase.TAKEOFF)

    def goto(
        self,
        x_m: float,
        y_m: float,
        altitude_m: float,
        *,
        heading: Heading = ALONG,
        speed_m_s: float | None = None,
        as_setpoint: bool = False,
    ) -> None:
        """Fly to a position relative to the start and hold there; emit TargetReached on arrival.

        With `as_setpoint`, a multirotor in the air flies to the position without a planned path.
        """
        settings = self.mission.settings
        self.flight.ready("fly to a position")
        self._check_height(altitude_m)
        farthest_m = self.spec.max_distance_m
        near = math.hypot(x_m, y_m) <= farthest_m
        require(near, f"cannot fly to ({x_m:g}, {y_m:g}): more than {farthest_m:g} m from the start")
        if speed_m_s is not None:
            settings.speed_m_s = self._checked_speed(speed_m_s)
        self.flight.disarm_step = None
        direct = as_setpoint and self.spec.hovers and self.flight.landed is not LandedState.ON_GROUND
        kind = LegKind.SETPOINT if direct else LegKind.WAYPOINT
        leg = Leg((x_m, y_m, altitude_m), settings.speed_m_s, heading=heading, kind=kind)
        self.flight.fly([leg], FlightPhase.GOTO)

    def steer(
        self,
        velocity_m_s: Position,
        *,
        height_m: float = math.nan,
        heading: Heading = KEEP,
    ) -> None:
        """Keep a velocity (east, north, up) until the next order; a descent ends with touch-down.

        The motion reduces a velocity beyond the vehicle's limits. If `height_m` is not NaN, the vehicle holds
        this altitude and ignores the vertical speed.
        """
        self.flight.ready("fly at a velocity")
        if not math.isnan(height_m):
            self._check_height(height_m)
        elif self.flight.landed is LandedState.ON_GROUND and not self.spec.drives:
            require(velocity_m_s[2] > 0.0, "cannot fly from the ground at a velocity that does not climb")
        self.flight.disarm_step = None
        self.flight.keep_velocity(velocity_m_s, height_m=height_m, heading=heading)

    def orbit(
        self,
        x_m: float,
        y_m: float,
        altitude_m: float,
        radius_m: float,
        speed_m_s: float,
        *,
        heading: Heading = INWARD,
    ) -> None:
        """Fly circles about a position; a positive radius is clockwise.

        A PX4 multirotor circles until the next order and points its nose as `heading` says. Any other vehicle
        flies 100 circles with its nose ahead, then holds.
        """
        self._in_air("orbit")
        self._check_height(altitude_m)
        able = 0.5 <= abs(radius_m) <= 1000.0 and math.hypot(x_m, y_m) <= self.spec.max_distance_m
        require(able, f"cannot orbit at {radius_m:g} m about ({x_m:g}, {y_m:g}): out of range")
        speed = self._checked_speed(speed_m_s)
        here = self.motion.position_m
        if self.spec.circles:
            legs = [circle_leg((x_m, y_m, altitude_m), speed, radius_m, MAX_TURNS)]
        else:
            legs = orbit_legs((x_m, y_m, altitude_m), here, radius_m, speed, heading, self.spec)
        self.flight.fly(legs, FlightPhase.GOTO)

    def return_home(self, position_m: Position | None = None) -> None:
        """Climb to the return altitude, fly home or to the nearest rally point, and land.

        If `position_m` (east, north, minimum height) is given, the vehicle brakes, flies there and holds.
        """
        self._in_air("return home")
        self.flight.look_at(None)
        speed = max(self.mission.settings.speed_m_s, self.spec.cruise_speed_m_s)
        if self.spec.circles:
            self._return_circling(position_m, speed)
            return
        x, y, z = self.motion.stopping_point()
        legs: list[Leg] = []
        if math.hypot(x - self.motion.position_m[0], y - self.motion.position_m[1]) > _BRAKING_M:
            legs.append(Leg((x, y, z), self.spec.top_speed_m_s, heading=KEEP, kind=LegKind.STAY))
        if position_m is None:
            legs += self._home_legs((x, y, z), speed)
            self.flight.fly(legs, FlightPhase.RETURN, AfterLastLeg.TOUCHDOWN)
            return
        height = max(position_m[2], self.mission.spec_about_home(self.spec).return_altitude_m, z)
        legs.append(Leg((x, y, height), speed, self.spec.acceptance_radius_m, KEEP, LegKind.CLIMB))
        legs.append(Leg((position_m[0], position_m[1], height), speed))
        self.flight.fly(legs, FlightPhase.GOTO)

    def _return_circling(self, position_m: Position | None, speed: float) -> None:
        """Fly a fixed wing to a circle at `position_m` or over home, or to the mission's landing."""
        here = self.motion.position_m
        if position_m is not None:
            height = max(position_m[2], self.mission.spec_about_home(self.spec).return_altitude_m, here[2])
            self.flight.fly([circle_leg((position_m[0], position_m[1], height), speed)], FlightPhase.GOTO)
            return
        own = fixed_wing_procedures(self.spec).lands_as_mission(self.spec)
        legs = (self.mission.landing_legs() if own else []) or self._home_legs(here, speed)
        after = AfterLastLeg.TOUCHDOWN if lands(legs) else AfterLastLeg.NEXT
        self.flight.fly(legs, FlightPhase.RETURN, after)

    def _home_legs(self, here: Position, speed: float) -> list[Leg]:
        procedures, spec = flight_procedures(self.spec), self.mission.spec_about_home(self.spec)
        return procedures.return_legs(spec, here, speed, self.mission.return_point())

    def land(self) -> None:
        """Land at the present position."""
        self._in_air("land")
        self.flight.look_at(None)
        x, y, _ = self.motion.stopping_point()
        here = self.motion.position_m
        legs = flight_procedures(self.spec).landing_legs(
            self.spec, (x, y, here[2]), here, self.mission.settings.speed_m_s
        )
        self.flight.fly(legs, FlightPhase.LAND, AfterLastLeg.TOUCHDOWN)

    def set_speed(self, speed_m_s: float) -> None:
        """Set the ground speed until an item of the mission changes the speed."""
        self.mission.settings.speed_m_s = self._checked_speed(speed_m_s)
        self.mission.apply_speed()

    def advance(self, until_s: float) -> list[FlightEvent]:
        """Fly until a time and return the events of the flight in order."""
        self.mission.run(self._step_at(until_s), stop_each=True)
        return self.flight.take_events()

    def fly_through(self, limit_s: float) -> list[FlightEvent]:
        """Fly until the mission is over or the time limit is reached, and return the events in order.

        The flight is the same as with `advance`, but computed faster, without a stop at each leg.
        """
        self.mission.run(self._step_at(limit_s), stop_each=False)
        return self.flight.take_events()

    def course_through(self, limit_s: float) -> Generator[tuple[int, bool], MotionEvent, list[FlightEvent]]:
        """Fly as `fly_through` does, while the caller advances the motion; see `MissionSequencer.course`."""
        yield from self.mission.course(self._step_at(limit_s), stop_each=False)
        return self.flight.take_events()

    def state(self) -> VehicleState:
        """Return the present state of the vehicle."""
        return self.flight.state_at(self.mission.current_seq)

    def _step_at(self, time_s: float) -> int:
        return math.floor(time_s / self.motion.step_s + 1e-6)

    def _in_air(self, what: str) -> None:
        self.flight.ready(what)
        require(self.flight.landed is not LandedState.ON_GROUND, f"cannot {what} from the ground")

    def _check_height(self, altitude_m: float) -> None:
        text = f"altitude {altitude_m:g} m is outside 0..{self.spec.max_altitude_m:g}"
        require(self.spec.reaches(altitude_m), text)

    def _checked_speed(self, speed_m_s: float) -> float:
        most_m_s = self.spec.top_speed_m_s
        require(0.0 < speed_m_s <= most_m_s, f"speed {speed_m_s:g} m/s is outside 0..{most_m_s:g}")
        return speed_m_s
