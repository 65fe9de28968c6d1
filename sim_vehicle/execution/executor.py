"""Flies mission items and direct targets over a motion model. Pure: no MAVLink, no clock of its own."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.model import Command
from sim_vehicle.airframe.spec import AIR_DENSITY_KG_M3, GRAVITY_M_S2, VehicleSpec
from sim_vehicle.autopilot import fixed_wing_procedures, flight_procedures
from sim_vehicle.energy.battery import remaining_fraction
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.feasibility import check_mission
from sim_vehicle.execution.fixed_wing_items import circle_leg, circles, lands
from sim_vehicle.execution.items import MAX_TURNS, Ending, do_items, plan_item_legs
from sim_vehicle.execution.legs import circle_legs
from sim_vehicle.execution.sequencer import MissionSequencer
from sim_vehicle.execution.state import FlightEvent, LandedState, Phase, VehicleState
from sim_vehicle.motion.legs import ALONG, KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Generator

    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionEvent

__all__ = ["MissionExecutor", "check_mission"]

_LANDING_COMMANDS = frozenset({16, 18, 19, 21, 31})


class MissionExecutor(MissionSequencer):
    """One vehicle in flight.

    Use: ``load(items)``, ``arm()``, ``start()``, then ``advance(until_s)`` again and again. Orders take
    effect at the time that the vehicle was advanced to.

    Parameters
    ----------
    spec : VehicleSpec
    frame : LocalFrame
        About home: origin (0, 0) is home, ``altitude_m`` the height of the ground there above sea level.
    wind : Wind, optional
        The ideal vehicle knows none.
    yaw_rad : float
        Compass heading at the start.

    Attributes
    ----------
    armed : bool
        Whether the motors run.
    phase : Phase
        What the vehicle is doing.
    landed : LandedState
        Ground contact.
    items : tuple of MissionItem
        The mission.
    current_seq : int
        The item that is being flown or comes next, -1 without a mission.
    takes_off : bool
        Whether a mission that begins on the ground without a take-off item climbs first, to the height of
        its place or the take-off altitude if that is higher (as PX4 does).
    """

    def update_spec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits; they hold from the next leg or order on."""
        if spec.kind != self.spec.kind or spec.step_s != self.spec.step_s:
            msg = f"vehicle {spec.name}: another kind or time step cannot be taken in flight"
            raise VehicleError(msg)
        if self._settings.speed_m_s == self.spec.cruise_speed_m_s:
            self._settings.speed_m_s = spec.cruise_speed_m_s
        self.spec = spec
        self.motion.update_spec(spec)

    def arm(self) -> None:
        """Start the motors.

        Raises
        ------
        VehicleError
            When the battery is empty.
        """
        battery = self.spec.battery
        if battery is not None and remaining_fraction(battery, self.motion.energy_j) <= 0.0:
            msg = "the battery is empty: change it before arming"
            raise VehicleError(msg)
        self.armed = True
        self._disarm_step = None

    def disarm(self, *, force: bool = False) -> None:
        """Stop the motors. Forced in the air, the vehicle drops: it is on the ground at once.

        Raises
        ------
        VehicleError
            In the air, unless forced.
        """
        if self.landed is not LandedState.ON_GROUND:
            if not force:
                msg = "cannot disarm in flight: land first, or force it"
                raise VehicleError(msg)
            self._ground()
        self.armed = False
        self._disarm_step = None
        self._drop_plan(Phase.GROUND)

    def start(self) -> None:
        """Begin the mission, or resume it at the current item.

        Raises
        ------
        VehicleError
            When not armed, nothing is loaded, or the battery is empty.
        """
        self._ready("start the mission")
        if not self.items:
            msg = "cannot start the mission: none is loaded"
            raise VehicleError(msg)
        self._disarm_step = None
        self._drop_plan(Phase.MISSION)
        self._continue(self.current_seq)

    def set_current(self, seq: int) -> None:
        """Make an item the current one; a mission in flight goes on with it at once.

        Raises
        ------
        VehicleError
            When there is no such item.
        """
        if not 0 <= seq < len(self.items):
            msg = f"mission item {seq}: the mission has {len(self.items)} items"
            raise VehicleError(msg)
        self._settings.jumps.clear()
        self._set_current(seq)
        if self.phase is Phase.MISSION:
            self._drop_plan(Phase.MISSION)
            self._continue(seq)

    def takeoff(self, altitude_m: float) -> None:
        """Climb to an altitude above home and hold there; TargetReached tells when.

        Raises
        ------
        VehicleError
            When not armed, or the altitude is out of range.
        """
        self._ready("take off")
        if self.spec.kind == "rover":
            msg = "cannot take off: a rover stays on the ground"
            raise VehicleError(msg)
        self._check_height(altitude_m)
        x, y, z = self.motion.position_m
        self._disarm_step = None
        self._settings.speed_m_s = self.spec.cruise_speed_m_s
        top = (x, y, max(altitude_m, z))
        self._fly([Leg(top, self._settings.speed_m_s, heading=KEEP, kind=LegKind.TAKEOFF)], Phase.TAKEOFF)

    def goto(
        self,
        x_m: float,
        y_m: float,
        altitude_m: float,
        *,
        heading: Heading = ALONG,
        speed_m_s: float | None = None,
    ) -> None:
        """Fly to a position about home and hold there; TargetReached tells when.

        Raises
        ------
        VehicleError
            Not armed, too far from home, or out of the range of altitudes or speeds.
        """
        self._ready("fly to a place")
        self._check_height(altitude_m)
        if not math.hypot(x_m, y_m) <= self.spec.max_distance_m:
            msg = f"cannot fly to ({x_m:g}, {y_m:g}): more than {self.spec.max_distance_m:g} m from home"
            raise VehicleError(msg)
        if speed_m_s is not None:
            self._settings.speed_m_s = self._checked_speed(speed_m_s)
        self._disarm_step = None
        self._fly([Leg((x_m, y_m, altitude_m), self._settings.speed_m_s, heading=heading)], Phase.GOTO)

    def steer(
        self,
        velocity_m_s: Position,
        *,
        height_m: float = math.nan,
        heading: Heading = KEEP,
    ) -> None:
        """Keep a velocity (east, north, up) until another order; sinking ends with touch-down.

        Parameters
        ----------
        velocity_m_s : tuple of 3 floats
            More than the vehicle flies is reduced.
        height_m : float
            Height to keep instead of the vertical speed, NaN for none.
        heading : Heading

        Raises
        ------
        VehicleError
            When not armed, on the ground without a climb, the height is out of range, or the vehicle has no
            velocity control.
        """
        self._ready("fly at a velocity")
        if not math.isnan(height_m):
            self._check_height(height_m)
        elif self.landed is LandedState.ON_GROUND and not velocity_m_s[2] > 0.0:
            msg = "cannot fly at a velocity: on the ground"
            raise VehicleError(msg)
        self._disarm_step = None
        self.motion.set_climb(None, None)
        self._keep_velocity(velocity_m_s, height_m=height_m, heading=heading)
        self.phase = Phase.STEERED
        self._timer = self._waiting_step = None
        self._waiting = []

    def orbit(self, x_m: float, y_m: float, altitude_m: float, radius_m: float, speed_m_s: float) -> None:
        """Fly circles about a place (clockwise with a positive radius), a hundred of them, then hold.

        Raises
        ------
        VehicleError
            On the ground, or out of the range of altitudes, speeds, distances or radii (0.5 to 1000 m).
        """
        self._in_air("orbit")
        self._check_height(altitude_m)
        if not 0.5 <= abs(radius_m) <= 1000.0 or not math.hypot(x_m, y_m) <= self.spec.max_distance_m:
            msg = f"cannot orbit at {radius_m:g} m about ({x_m:g}, {y_m:g}): out of range"
            raise VehicleError(msg)
        speed = self._checked_speed(speed_m_s)
        here = self.motion.position_m
        if circles(self.spec):
            legs = [circle_leg((x_m, y_m, altitude_m), speed, radius_m, MAX_TURNS)]
        else:
            legs = circle_legs((x_m, y_m, altitude_m), here, MAX_TURNS, radius_m, speed, self.spec)
        self._fly(legs, Phase.GOTO)

    def return_home(self, position_m: Position | None = None) -> None:
        """Climb to the return altitude, fly home or to the nearest rally point, land.

        A position (east, north, least height) is returned to instead and not landed at; the vehicle brakes
        before it turns to it.

        Raises
        ------
        VehicleError
            On the ground.
        """
        self._in_air("return home")
        self.look_at(None)
        speed = max(self._settings.speed_m_s, self.spec.cruise_speed_m_s)
        if circles(self.spec):
            self._return_circling(position_m, speed)
            return
        x, y, z = self.motion.stopping_point()
        legs: list[Leg] = []
        if math.hypot(x - self.motion.position_m[0], y - self.motion.position_m[1]) > 0.2:
            legs.append(Leg((x, y, z), self.spec.top_speed_m_s, heading=KEEP, kind=LegKind.STAY))
        if position_m is None:
            home = flight_procedures(self.spec).return_legs(self.spec, (x, y, z), speed, self.haven())
            self._fly(legs + home, Phase.RETURN, Ending.TOUCHDOWN)
            return
        height = max(position_m[2], self.spec.return_altitude_m, z)
        legs.append(Leg((x, y, height), speed, self.spec.acceptance_radius_m, KEEP, LegKind.CLIMB))
        legs.append(Leg((position_m[0], position_m[1], height), speed))
        self._fly(legs, Phase.GOTO)

    def _return_circling(self, position_m: Position | None, speed: float) -> None:
        """Return as a fixed wing does: to a circle there or over home, or to the landing of the mission."""
        here = self.motion.position_m
        if position_m is not None:
            height = max(position_m[2], self.spec.return_altitude_m, here[2])
            self._fly([circle_leg((position_m[0], position_m[1], height), speed)], Phase.GOTO)
            return
        legs = self._mission_landing(here)
        if not legs:
            legs = flight_procedures(self.spec).return_legs(self.spec, here, speed, self.haven())
        self._fly(legs, Phase.RETURN, Ending.TOUCHDOWN if lands(legs) else Ending.NEXT)

    def _mission_landing(self, here: Position) -> list[Leg]:
        """Return the legs of the mission's landing, where it has one and a return is to use it."""
        starts = [seq for seq, item in enumerate(self.items) if item.command == Command.DO_LAND_START]
        if not starts or not fixed_wing_procedures(self.spec).lands_as_mission(self.spec):
            return []
        legs: list[Leg] = []
        seq = starts[0]
        settings = self._settings.copy()
        while True:
            _, seq = do_items(self.items, seq, settings, self.spec.top_speed_m_s)
            if not 0 <= seq < len(self.items) or self.items[seq].command not in _LANDING_COMMANDS:
                return []
            plan = plan_item_legs(self.items, self._places, seq, settings, self.spec, here, self.haven())
            legs += plan.legs
            here = legs[-1].end_m
            if plan.ending is Ending.TOUCHDOWN:
                return legs
            seq = plan.seqs[-1] + 1

    def land(self) -> None:
        """Land here.

        Raises
        ------
        VehicleError
            On the ground.
        """
        self._in_air("land")
        self.look_at(None)
        x, y, _ = self.motion.stopping_point()
        here = self.motion.position_m
        legs = flight_procedures(self.spec).landing_legs(
            self.spec, (x, y, here[2]), here, self._settings.speed_m_s
        )
        self._fly(legs, Phase.LAND, Ending.TOUCHDOWN)

    def set_speed(self, speed_m_s: float) -> None:
        """Set the ground speed until the mission sets another.

        Raises
        ------
        VehicleError
            When it is not positive, or beyond what the vehicle flies.
        """
        self._settings.speed_m_s = self._checked_speed(speed_m_s)
        if self.phase is Phase.STEERED:
            return
        plan = self._plan
        if plan is None or self._timer is not None:
            return
        if self.phase is Phase.MISSION:
            self._fly_from(self.current_seq, self.time_s)
        elif self.phase in (Phase.GOTO, Phase.RETURN):
            legs = [
                leg if leg.descends else replace(leg, speed_m_s=speed_m_s) for leg in plan.legs[self._flown :]
            ]
            self._fly(legs, self.phase, plan.ending)

    def advance(self, until_s: float) -> list[FlightEvent]:
        """Fly until a time and return what happened, in order, each event with its own time."""
        target = math.floor(until_s / self.motion.step_s + 1e-6)
        self._run(target, stop_each=True)
        return self._take_events()

    def fly_through(self, limit_s: float) -> list[FlightEvent]:
        """Fly until the mission is over, or to a time limit; events in order.

        The same flight as with `advance`, faster: places that need no decision are not returned to one by
        one.
        """
        self._run(math.floor(limit_s / self.motion.step_s + 1e-6), stop_each=False)
        return self._take_events()

    def course_through(self, limit_s: float) -> Generator[tuple[int, bool], MotionEvent, list[FlightEvent]]:
        """Fly as `fly_through` does, while somebody else moves the vehicle.

        Yields what ``motion.advance`` is to be called with, steps and whether to stop at each leg, and is
        sent the event that it returned. The generator's value are the events of the flight.
        """
        yield from self._course(math.floor(limit_s / self.motion.step_s + 1e-6), stop_each=False)
        return self._take_events()

    def state(self) -> VehicleState:
        """Return the state now."""
        now, spec = self.motion.snapshot(), self.spec
        vx, vy, _ = now.velocity_m_s
        wind_x, wind_y = now.wind_m_s
        air_x, air_y = vx - wind_x, vy - wind_y
        airspeed = math.sqrt(air_x * air_x + air_y * air_y)
        roll = pitch = 0.0
        if self.landed is not LandedState.ON_GROUND and not spec.is_ideal:
            drag = 0.0
            if spec.power is not None:
                drag = 0.5 * AIR_DENSITY_KG_M3 * spec.power.drag_area_m2 * airspeed / spec.power.mass_kg
            ax, ay, az = now.acceleration_m_s2
            sin, cos = math.sin(now.heading_rad), math.cos(now.heading_rad)
            east, north = ax + drag * air_x, ay + drag * air_y
            lift = GRAVITY_M_S2 + az
            pitch = -math.atan2(east * sin + north * cos, lift)
            roll = math.atan2((east * cos - north * sin) * math.cos(pitch), lift)
        throttle = 0.5
        attitude = self.motion.attitude()
        if attitude is not None:
            roll, pitch, airspeed, throttle = attitude
        meter = self._meter
        battery = meter.read(self.motion.time_s, now.energy_j, now.power_w) if meter is not None else None
        return VehicleState(
            time_s=self.motion.time_s,
            position_m=now.position_m,
            velocity_m_s=now.velocity_m_s,
            acceleration_m_s2=now.acceleration_m_s2,
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rad=now.heading_rad,
            yaw_rate_rad_s=now.yaw_rate_rad_s,
            airspeed_m_s=airspeed,
            wind_m_s=now.wind_m_s,
            power_w=now.power_w,
            battery=battery,
            path_length_m=now.path_length_m,
            armed=self.armed,
            landed=self.landed,
            phase=self.phase,
            current_seq=self.current_seq,
            throttle=throttle,
        )

    def _ready(self, what: str) -> None:
        if not self.armed:
            msg = f"cannot {what}: not armed"
            raise VehicleError(msg)
        self._check_power(what)

    def _in_air(self, what: str) -> None:
        self._ready(what)
        if self.landed is LandedState.ON_GROUND:
            msg = f"cannot {what}: on the ground"
            raise VehicleError(msg)

    def _check_height(self, altitude_m: float) -> None:
        if self.spec.kind != "rover" and not 0.0 < altitude_m <= self.spec.max_altitude_m:
            msg = f"altitude {altitude_m:g} m is outside 0..{self.spec.max_altitude_m:g}"
            raise VehicleError(msg)

    def _checked_speed(self, speed_m_s: float) -> float:
        if not 0.0 < speed_m_s <= self.spec.top_speed_m_s:
            msg = f"speed {speed_m_s:g} m/s is outside 0..{self.spec.top_speed_m_s:g}"
            raise VehicleError(msg)
        return speed_m_s
