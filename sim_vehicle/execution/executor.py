"""Takes orders for one vehicle and flies them, and its mission. Pure: no MAVLink, no clock of its own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_vehicle.autopilot import fixed_wing_procedures, flight_procedures
from sim_vehicle.energy.battery import remaining_fraction
from sim_vehicle.epoch import EPOCH_UNIX_S
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.fixed_wing_items import circle_leg, lands
from sim_vehicle.execution.items import MAX_TURNS
from sim_vehicle.execution.leg_follower import LegFollower
from sim_vehicle.execution.legs import AfterLastLeg, circle_legs
from sim_vehicle.execution.sequencer import MissionSequencer, ReturnPoints
from sim_vehicle.execution.state import FlightEvent, FlightPhase, LandedState, VehicleState
from sim_vehicle.motion.legs import ALONG, KEEP, Heading, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from geo.frame import LocalFrame
    from mission.model import MissionItem
    from sim_vehicle.airframe.estimate_errors import EstimateErrors
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position
    from sim_vehicle.motion.model import MotionEvent, MotionModel
    from sim_vehicle.weather.wind import Wind

__all__ = ["MissionExecutor"]

# A vehicle that comes to rest within this distance needs no leg to brake.
_BRAKING_M = 0.2


class MissionExecutor:
    """One vehicle in flight: its `follower` flies legs, its `sequencer` the mission.

    Use: ``load(items)``, ``arm()``, ``start()``, then ``advance(until_s)`` again and again. Orders take
    effect at the time that the vehicle was advanced to; one that cannot be taken raises VehicleError.

    Parameters
    ----------
    frame : LocalFrame
        About home: origin (0, 0) is home, ``altitude_m`` the height of the ground there above sea level.
    wind : Wind, optional
        The ideal vehicle knows none.
    yaw_rad : float
        Compass heading at the start.
    takes_off, epoch_unix_s
        See `sim_vehicle.execution.sequencer.MissionSequencer`.
    estimate_errors : EstimateErrors, optional
        How wrong the autopilot's estimate is, where it is known to be; exact without.
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
        self.frame = frame
        self.follower = LegFollower(spec, wind=wind, yaw_rad=yaw_rad)
        if estimate_errors is not None:
            self.follower.motion.estimate_with(estimate_errors)
        self.sequencer = MissionSequencer(
            self.follower, frame, takes_off=takes_off, epoch_unix_s=epoch_unix_s
        )

    @property
    def spec(self) -> VehicleSpec:
        """The vehicle, with the defaults and limits that hold now."""
        return self.follower.spec

    @property
    def motion(self) -> MotionModel:
        """The motion model of the vehicle."""
        return self.follower.motion

    @property
    def time_s(self) -> float:
        """The time that the vehicle was advanced to, on its grid of steps."""
        return self.follower.motion.time_s

    @property
    def armed(self) -> bool:
        """Whether the motors run."""
        return self.follower.armed

    @property
    def phase(self) -> FlightPhase:
        """The current phase of the flight."""
        return self.follower.phase

    @property
    def landed(self) -> LandedState:
        """Ground contact."""
        return self.follower.landed

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """The mission."""
        return self.sequencer.items

    @property
    def current_seq(self) -> int:
        """The item that is being flown or comes next, -1 without a mission."""
        return self.sequencer.current_seq

    @property
    def return_points(self) -> ReturnPoints:
        """Home and rally points."""
        return self.sequencer.return_points

    def load(
        self,
        items: Sequence[MissionItem],
        positions: list[Position] | None = None,
        current: int = 0,
        *,
        keeps_settings: bool = False,
    ) -> None:
        """Replace the mission: see `MissionSequencer.load`."""
        self.sequencer.load(items, positions, current, keeps_settings=keeps_settings)

    def change(
        self, items: Sequence[MissionItem], seq: int, *, at_waypoints: bool = False, keeps_jumps: bool = False
    ) -> bool:
        """Replace the mission that is flown, and go on at an item: see `MissionSequencer.change`."""
        self._ready("change the mission")
        return self.sequencer.change(items, seq, at_waypoints=at_waypoints, keeps_jumps=keeps_jumps)

    def update_spec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits; they hold from the next leg or order on."""
        same = spec.kind == self.spec.kind and spec.step_s == self.spec.step_s
        _require(same, f"vehicle {spec.name}: another kind or time step cannot be taken in flight")
        settings = self.sequencer.settings
        if settings.speed_m_s == self.spec.cruise_speed_m_s:
            settings.speed_m_s = spec.cruise_speed_m_s
        self.follower.update_spec(spec)

    def arm(self) -> None:
        """Start the motors."""
        battery = self.spec.battery
        empty = battery is not None and remaining_fraction(battery, self.motion.energy_j) <= 0.0
        _require(not empty, "the battery is empty: change it before arming")
        self.follower.armed = True
        self.follower.disarm_step = None

    def disarm(self, *, force: bool = False) -> None:
        """Stop the motors. Forced in the air, the vehicle drops: it is on the ground at once."""
        if self.landed is not LandedState.ON_GROUND:
            _require(force, "cannot disarm in flight: land first, or force it")
            self.follower.touch_down()
        self.follower.stop_motors()

    def stay_armed(self) -> None:
        """Let the motors run on after a touch-down, until another order."""
        if self.landed is LandedState.ON_GROUND and not self.phase.is_lost:
            self.follower.disarm_step = None

    def start(self) -> None:
        """Begin the mission, or resume it at the current item."""
        self._ready("start the mission")
        _require(bool(self.items), "cannot start the mission: none is loaded")
        self.sequencer.start(self.current_seq)

    def set_current(self, seq: int) -> None:
        """Make an item the current one; a mission in flight goes on with it at once."""
        count = len(self.items)
        _require(0 <= seq < count, f"mission item {seq}: the mission has {count} items")
        self.sequencer.set_current(seq)

    def takeoff(self, altitude_m: float) -> None:
        """Climb to an altitude above home and hold there; TargetReached tells when."""
        self._ready("take off")
        _require(not self.spec.drives, f"cannot take off: a {self.spec.kind} stays on the ground")
        self._check_height(altitude_m)
        x, y, z = self.motion.position_m
        self.follower.disarm_step = None
        self.sequencer.settings.speed_m_s = speed = self.spec.cruise_speed_m_s
        climb = Leg((x, y, max(altitude_m, z)), speed, heading=KEEP, kind=LegKind.TAKEOFF)
        self.follower.fly([climb], FlightPhase.TAKEOFF)

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
        """Fly to a position about home and hold there; TargetReached tells when.

        As a setpoint, a multirotor in the air goes there without a path.
        """
        settings = self.sequencer.settings
        self._ready("fly to a position")
        self._check_height(altitude_m)
        farthest_m = self.spec.max_distance_m
        near = math.hypot(x_m, y_m) <= farthest_m
        _require(near, f"cannot fly to ({x_m:g}, {y_m:g}): more than {farthest_m:g} m from home")
        if speed_m_s is not None:
            settings.speed_m_s = self._checked_speed(speed_m_s)
        self.follower.disarm_step = None
        direct = as_setpoint and self.spec.hovers and self.landed is not LandedState.ON_GROUND
        kind = LegKind.SETPOINT if direct else LegKind.WAYPOINT
        leg = Leg((x_m, y_m, altitude_m), settings.speed_m_s, heading=heading, kind=kind)
        self.follower.fly([leg], FlightPhase.GOTO)

    def steer(
        self,
        velocity_m_s: Position,
        *,
        height_m: float = math.nan,
        heading: Heading = KEEP,
    ) -> None:
        """Keep a velocity (east, north, up) until another order; sinking ends with touch-down.

        More than the vehicle flies is reduced; ``height_m`` is kept instead of the vertical speed unless it
        is NaN.
        """
        self._ready("fly at a velocity")
        if not math.isnan(height_m):
            self._check_height(height_m)
        elif self.landed is LandedState.ON_GROUND and not self.spec.drives:
            _require(velocity_m_s[2] > 0.0, "cannot fly at a velocity: on the ground")
        self.follower.disarm_step = None
        self.follower.keep_velocity(velocity_m_s, height_m=height_m, heading=heading)

    def orbit(self, x_m: float, y_m: float, altitude_m: float, radius_m: float, speed_m_s: float) -> None:
        """Fly circles about a position (clockwise with a positive radius), a hundred of them, then hold."""
        self._in_air("orbit")
        self._check_height(altitude_m)
        able = 0.5 <= abs(radius_m) <= 1000.0 and math.hypot(x_m, y_m) <= self.spec.max_distance_m
        _require(able, f"cannot orbit at {radius_m:g} m about ({x_m:g}, {y_m:g}): out of range")
        speed = self._checked_speed(speed_m_s)
        here = self.motion.position_m
        if self.spec.circles:
            legs = [circle_leg((x_m, y_m, altitude_m), speed, radius_m, MAX_TURNS)]
        else:
            legs = circle_legs((x_m, y_m, altitude_m), here, MAX_TURNS, radius_m, speed, self.spec)
        self.follower.fly(legs, FlightPhase.GOTO)

    def return_home(self, position_m: Position | None = None) -> None:
        """Climb to the return altitude, fly home or to the nearest rally point, land.

        A position (east, north, least height) is returned to instead and not landed at; the vehicle brakes
        before it turns to it.
        """
        self._in_air("return home")
        self.look_at(None)
        speed = max(self.sequencer.settings.speed_m_s, self.spec.cruise_speed_m_s)
        if self.spec.circles:
            self._return_circling(position_m, speed)
            return
        x, y, z = self.motion.stopping_point()
        legs: list[Leg] = []
        if math.hypot(x - self.motion.position_m[0], y - self.motion.position_m[1]) > _BRAKING_M:
            legs.append(Leg((x, y, z), self.spec.top_speed_m_s, heading=KEEP, kind=LegKind.STAY))
        if position_m is None:
            legs += self._home_legs((x, y, z), speed)
            self.follower.fly(legs, FlightPhase.RETURN, AfterLastLeg.TOUCHDOWN)
            return
        height = max(position_m[2], self.spec.return_altitude_m, z)
        legs.append(Leg((x, y, height), speed, self.spec.acceptance_radius_m, KEEP, LegKind.CLIMB))
        legs.append(Leg((position_m[0], position_m[1], height), speed))
        self.follower.fly(legs, FlightPhase.GOTO)

    def _return_circling(self, position_m: Position | None, speed: float) -> None:
        """Return as a fixed wing does: to a circle there or over home, or to the landing of the mission."""
        here = self.motion.position_m
        if position_m is not None:
            height = max(position_m[2], self.spec.return_altitude_m, here[2])
            self.follower.fly([circle_leg((position_m[0], position_m[1], height), speed)], FlightPhase.GOTO)
            return
        own = fixed_wing_procedures(self.spec).lands_as_mission(self.spec)
        legs = (self.sequencer.landing_legs() if own else []) or self._home_legs(here, speed)
        after = AfterLastLeg.TOUCHDOWN if lands(legs) else AfterLastLeg.NEXT
        self.follower.fly(legs, FlightPhase.RETURN, after)

    def _home_legs(self, here: Position, speed: float) -> list[Leg]:
        procedures = flight_procedures(self.spec)
        return procedures.return_legs(self.spec, here, speed, self.sequencer.return_point())

    def land(self) -> None:
        """Land here."""
        self._in_air("land")
        self.look_at(None)
        x, y, _ = self.motion.stopping_point()
        here = self.motion.position_m
        legs = flight_procedures(self.spec).landing_legs(
            self.spec, (x, y, here[2]), here, self.sequencer.settings.speed_m_s
        )
        self.follower.fly(legs, FlightPhase.LAND, AfterLastLeg.TOUCHDOWN)

    def go_around(self, height_m: float | None = None) -> float:
        """Break off the landing of the mission, climb, and begin it anew; return the height of the climb.

        By default that is the height of the landing item, or of the take-off.
        """
        self._ready("go around")
        return self.sequencer.go_around(height_m)

    def set_speed(self, speed_m_s: float) -> None:
        """Set the ground speed until the mission sets another."""
        self.sequencer.settings.speed_m_s = self._checked_speed(speed_m_s)
        self.sequencer.apply_speed()

    def hold(self) -> None:
        """Stop and stay; `start` resumes a mission."""
        self.follower.hold()

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) whatever is flown, None for no more."""
        self.follower.look_at(position_m)

    def fall(self) -> None:
        """Lose the thrust: the vehicle comes down at once and can do nothing more."""
        self.follower.fall()

    def drain_battery(self, fraction: float) -> None:
        """Leave no more than this fraction in the battery; nothing for a vehicle without one."""
        self.follower.drain_battery(fraction)

    def advance(self, until_s: float) -> list[FlightEvent]:
        """Fly until a time; the events of the flight, in order, each with its own time."""
        self.sequencer.run(self._step_at(until_s), stop_each=True)
        return self.follower.take_events()

    def fly_through(self, limit_s: float) -> list[FlightEvent]:
        """Fly until the mission is over, or to a time limit; events in order.

        The same flight as with `advance`, faster: positions that need no decision are not returned to one by
        one.
        """
        self.sequencer.run(self._step_at(limit_s), stop_each=False)
        return self.follower.take_events()

    def course_through(self, limit_s: float) -> Generator[tuple[int, bool], MotionEvent, list[FlightEvent]]:
        """Fly as `fly_through` does, while the caller moves the vehicle: see `MissionSequencer.course`."""
        yield from self.sequencer.course(self._step_at(limit_s), stop_each=False)
        return self.follower.take_events()

    def state(self) -> VehicleState:
        """The state of the vehicle now."""
        return self.follower.state(self.sequencer.current_seq)

    def _step_at(self, time_s: float) -> int:
        return math.floor(time_s / self.motion.step_s + 1e-6)

    def _ready(self, what: str) -> None:
        _require(self.armed, f"cannot {what}: not armed")
        self.follower.check_power(what)

    def _in_air(self, what: str) -> None:
        self._ready(what)
        _require(self.landed is not LandedState.ON_GROUND, f"cannot {what}: on the ground")

    def _check_height(self, altitude_m: float) -> None:
        text = f"altitude {altitude_m:g} m is outside 0..{self.spec.max_altitude_m:g}"
        _require(self.spec.reaches(altitude_m), text)

    def _checked_speed(self, speed_m_s: float) -> float:
        most_m_s = self.spec.top_speed_m_s
        _require(0.0 < speed_m_s <= most_m_s, f"speed {speed_m_s:g} m/s is outside 0..{most_m_s:g}")
        return speed_m_s


def _require(able: bool, text: str) -> None:
    """Refuse an order that the vehicle is not able to take."""
    if not able:
        raise VehicleError(text)
