"""Flies mission items and direct targets over a motion model. Pure: no MAVLink, no clock of its own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mission.model import Command
from sim_vehicle.battery import battery_state
from sim_vehicle.errors import VehicleError
from sim_vehicle.feasibility import check_mission
from sim_vehicle.flight import (
    BatteryDepleted,
    CameraCommand,
    CannotFly,
    CurrentChanged,
    Disarmed,
    FlightEvent,
    ItemReached,
    Landed,
    LandedState,
    MissionComplete,
    Phase,
    TargetReached,
    VehicleState,
)
from sim_vehicle.itinerary import (
    ALONG,
    CAMERA_COMMANDS,
    CONDITIONS,
    KEEP,
    Ending,
    Itinerary,
    Settings,
    condition_items,
    do_items,
    item_places,
    landing_rows,
    number,
    plan_item_legs,
    return_rows,
)
from sim_vehicle.motion.model import MotionEvent, Route
from sim_vehicle.spec import AIR_DENSITY_KG_M3, GRAVITY_M_S2

if TYPE_CHECKING:
    from collections.abc import Sequence

    from geo.frame import LocalFrame
    from mission.model import MissionItem
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.spec import VehicleSpec
    from sim_vehicle.wind import Wind

__all__ = ["MissionExecutor", "check_mission"]

_REPLAN_BEFORE = 64
_GAVE_UP = -2


class MissionExecutor:
    """One vehicle in flight.

    Use: ``load(items)``, ``arm()``, ``start()``, then ``advance(until_s)`` again and again. Orders take effect at the
    time that the vehicle was advanced to.

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
    """

    def __init__(
        self, spec: VehicleSpec, frame: LocalFrame, *, wind: Wind | None = None, yaw_rad: float = 0.0
    ) -> None:
        self.spec = spec
        self.frame = frame
        self.armed = False
        self.phase = Phase.GROUND
        self.landed = LandedState.ON_GROUND
        self.items: tuple[MissionItem, ...] = ()
        self.current_seq = -1
        self.motion = _motion(spec, wind, yaw_rad)
        self._places: list[tuple[float, float, float]] = []
        self._settings = Settings(spec.cruise_speed_m_s)
        self._plan: Itinerary | None = None
        self._flown = 0
        self._timer: int | None = None
        self._disarm_step: int | None = None
        self._waiting: list[int] = []
        self._waiting_step: int | None = None
        self._events: list[FlightEvent] = []

    @property
    def time_s(self) -> float:
        """The time that the vehicle was advanced to, on its grid of steps."""
        return self.motion.time_s

    def load(self, items: Sequence[MissionItem]) -> None:
        """Replace the mission and begin it anew; a vehicle that is flying one holds."""
        if self.phase is Phase.MISSION:
            self.hold()
        self.items = tuple(items)
        self._places = item_places(self.items, self.frame)
        self._settings = Settings(self.spec.cruise_speed_m_s)
        self.current_seq = 0 if self.items else -1

    def respec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits; they hold from the next leg or order on."""
        if spec.kind != self.spec.kind or spec.step_s != self.spec.step_s:
            msg = f"vehicle {spec.name}: another kind or time step cannot be taken in flight"
            raise VehicleError(msg)
        if self._settings.speed_m_s == self.spec.cruise_speed_m_s:
            self._settings.speed_m_s = spec.cruise_speed_m_s
        self.spec = spec
        self.motion.respec(spec)

    def arm(self) -> None:
        """Start the motors.

        Raises
        ------
        VehicleError
            When the battery is empty.
        """
        battery = self.spec.battery
        if battery is not None and battery_state(battery, self.motion.energy_j, 0.0).depleted:
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
        self._check_height(altitude_m)
        x, y, z = self.motion.position_m
        self._disarm_step = None
        self._settings.speed_m_s = self.spec.cruise_speed_m_s
        self._fly([(x, y, max(altitude_m, z), 0.0, self._settings.speed_m_s, KEEP, 0.0)], Phase.TAKEOFF)

    def hold(self) -> None:
        """Stop and stay; `start` resumes a mission."""
        if self.landed is LandedState.ON_GROUND:
            self._drop_plan(Phase.GROUND)
            return
        self._check_power("hold")
        x, y, z = self.motion.stopping_point()
        self._fly([(x, y, z, 0.0, self.spec.top_speed_m_s, KEEP, 0.0)], Phase.HOLD)

    def goto(
        self,
        x_m: float,
        y_m: float,
        altitude_m: float,
        *,
        yaw_rad: float | None = None,
        speed_m_s: float | None = None,
    ) -> None:
        """Fly to a place about home and hold there; TargetReached tells when.

        Raises
        ------
        VehicleError
            On the ground, too far from home, or out of the range of altitudes or speeds.
        """
        self._in_air("fly to a place")
        self._check_height(altitude_m)
        if not math.hypot(x_m, y_m) <= self.spec.max_distance_m:
            msg = f"cannot fly to ({x_m:g}, {y_m:g}): more than {self.spec.max_distance_m:g} m from home"
            raise VehicleError(msg)
        if speed_m_s is not None:
            self._settings.speed_m_s = self._checked_speed(speed_m_s)
        heading = ALONG if yaw_rad is None else yaw_rad
        self._fly([(x_m, y_m, altitude_m, 0.0, self._settings.speed_m_s, heading, 0.0)], Phase.GOTO)

    def return_home(self) -> None:
        """Climb to the return altitude, fly home, land.

        Raises
        ------
        VehicleError
            On the ground.
        """
        self._in_air("return home")
        rows = return_rows(self.spec, self.motion.position_m, max(self._settings.speed_m_s, self.spec.cruise_speed_m_s))
        self._fly(rows, Phase.RETURN, Ending.TOUCHDOWN)

    def land(self) -> None:
        """Land here.

        Raises
        ------
        VehicleError
            On the ground.
        """
        self._in_air("land")
        x, y, _ = self.motion.stopping_point()
        here = self.motion.position_m
        rows = landing_rows(self.spec, (x, y, here[2]), here, self._settings.speed_m_s)
        self._fly(rows, Phase.LAND, Ending.TOUCHDOWN)

    def set_speed(self, speed_m_s: float) -> None:
        """Set the ground speed until the mission sets another.

        Raises
        ------
        VehicleError
            When it is not positive, or beyond what the vehicle flies.
        """
        self._settings.speed_m_s = self._checked_speed(speed_m_s)
        plan = self._plan
        if plan is None or self._timer is not None:
            return
        if self.phase is Phase.MISSION:
            self._fly_from(self.current_seq, self.time_s)
        elif self.phase in (Phase.GOTO, Phase.RETURN):
            rows = [(*r[:4], speed_m_s if r[4] > 0.0 else r[4], *r[5:]) for r in plan.rows[self._flown :]]
            self._fly(rows, self.phase, plan.ending)

    def advance(self, until_s: float) -> list[FlightEvent]:
        """Fly until a time and return what happened, in order, each event with its own time."""
        target = math.floor(until_s / self.motion.step_s + 1e-6)
        self._run(target, stop_each=True)
        return self._take_events()

    def fly_through(self, limit_s: float) -> list[FlightEvent]:
        """Fly until the mission is over, or to a time limit; events in order.

        The same flight as with `advance`, faster: places that need no decision are not returned to one by one.
        """
        self._run(math.floor(limit_s / self.motion.step_s + 1e-6), stop_each=False)
        return self._take_events()

    def state(self) -> VehicleState:
        """Return the state now."""
        x, y, z, vx, vy, vz, ax, ay, az, yaw, yaw_rate, energy, length, power, _, wx, wy = self.motion.numbers()
        spec = self.spec
        air_x, air_y = vx - wx, vy - wy
        airspeed = math.sqrt(air_x * air_x + air_y * air_y)
        roll = pitch = 0.0
        if self.landed is not LandedState.ON_GROUND and not spec.is_ideal:
            drag = 0.0
            if spec.power is not None:
                drag = 0.5 * AIR_DENSITY_KG_M3 * spec.power.drag_area_m2 * airspeed / spec.power.mass_kg
            sin, cos = math.sin(yaw), math.cos(yaw)
            east, north = ax + drag * air_x, ay + drag * air_y
            lift = GRAVITY_M_S2 + az
            pitch = -math.atan2(east * sin + north * cos, lift)
            roll = math.atan2((east * cos - north * sin) * math.cos(pitch), lift)
        battery = battery_state(spec.battery, energy, power) if spec.battery is not None else None
        return VehicleState(
            time_s=self.motion.time_s,
            position_m=(x, y, z),
            velocity_m_s=(vx, vy, vz),
            acceleration_m_s2=(ax, ay, az),
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rad=yaw,
            yaw_rate_rad_s=yaw_rate,
            airspeed_m_s=airspeed,
            wind_m_s=(wx, wy),
            power_w=power,
            battery=battery,
            path_length_m=length,
            armed=self.armed,
            landed=self.landed,
            phase=self.phase,
            current_seq=self.current_seq,
        )

    # Orders ---------------------------------------------------------------------------------------------------------

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

    def _check_power(self, what: str) -> None:
        if self.phase is Phase.DEPLETED:
            msg = f"cannot {what}: the battery is empty"
            raise VehicleError(msg)

    def _check_height(self, altitude_m: float) -> None:
        if not 0.0 < altitude_m <= self.spec.max_altitude_m:
            msg = f"altitude {altitude_m:g} m is outside 0..{self.spec.max_altitude_m:g}"
            raise VehicleError(msg)

    def _checked_speed(self, speed_m_s: float) -> float:
        if not 0.0 < speed_m_s <= self.spec.top_speed_m_s:
            msg = f"speed {speed_m_s:g} m/s is outside 0..{self.spec.top_speed_m_s:g}"
            raise VehicleError(msg)
        return speed_m_s

    def _fly(
        self, rows: list[tuple[float, float, float, float, float, float, float]], phase: Phase, ending: Ending = Ending.NEXT
    ) -> None:
        plan = Itinerary(ending=ending)
        for row in rows:
            plan.add(row)
        self._drop_plan(phase)
        self._begin(plan)

    def _drop_plan(self, phase: Phase) -> None:
        self._plan = None
        self._timer = None
        self._waiting = []
        self._waiting_step = None
        self.phase = phase

    def _begin(self, plan: Itinerary) -> None:
        self._plan = plan
        self._flown = 0
        self._timer = None
        if self._waits(Command.CONDITION_DISTANCE):
            near = max(number(self.items[self._waiting[0]].param1), 1e-3)
            plan.rows[0] = (*plan.rows[0][:6], near)
        self.motion.fly(Route.through(plan.rows))
        if self.landed is LandedState.ON_GROUND:
            self.landed = LandedState.TAKEOFF

    # Flight ---------------------------------------------------------------------------------------------------------

    def _take_events(self) -> list[FlightEvent]:
        events, self._events = self._events, []
        return events

    def _tell(self, event: FlightEvent) -> None:
        self._events.append(event)

    def _set_current(self, seq: int, time_s: float | None = None) -> None:
        if seq != self.current_seq:
            self.current_seq = seq
            self._tell(CurrentChanged(self.time_s if time_s is None else time_s, seq))

    def _run(self, target: int, *, stop_each: bool) -> None:
        motion = self.motion
        while motion.step < target:
            limit = target
            for step in (self._timer, self._disarm_step, self._waiting_step):
                if step is not None and step < limit:
                    limit = max(step, motion.step)
            flying = self._plan is not None and self.landed is not LandedState.ON_GROUND
            event = MotionEvent.RAN
            if flying:
                closely = stop_each or self._plan_needs_care()
                event = motion.advance(limit - motion.step, stop_each=closely)
                self._account(event)
            elif limit > motion.step:
                motion.rest(limit - motion.step, armed=self.armed)
                self._drain_on_ground()
            if self._timer is not None and motion.step >= self._timer:
                self._timer = None
                self._complete_item()
            if self._waiting_step is not None and motion.step >= self._waiting_step:
                self._release()
            if self._disarm_step is not None and motion.step >= self._disarm_step:
                self._disarm_step = None
                self.armed = False
                self._drop_plan(Phase.GROUND)
                self._tell(Disarmed(self.time_s))
            if not stop_each and (self._over() or self._stuck()):
                return

    def _over(self) -> bool:
        return self.phase is not Phase.MISSION and self._disarm_step is None and (
            self.landed is LandedState.ON_GROUND or self.phase is Phase.HOLD
        )

    def _stuck(self) -> bool:
        """Whether the mission stays where it is for ever."""
        plan = self._plan
        return plan is not None and plan.ending is Ending.FOREVER and self._flown == len(plan.rows)

    def _plan_needs_care(self) -> bool:
        """Whether legs have to be looked at one by one even in a prediction."""
        return bool(self._waiting) or (self._plan is not None and self._plan.open)

    def _account(self, event: MotionEvent) -> None:
        """Complete the legs that were flown, and take what ended the motion."""
        plan = self._plan
        motion = self.motion
        assert plan is not None
        reached = motion.leg + (1 if motion.arrivals[motion.leg] >= 0 else 0)
        while self._flown < reached:
            leg = self._flown
            self._flown += 1
            self._leg_done(plan, leg, int(motion.arrivals[leg]) * motion.step_s)
            if self._plan is not plan:
                return
        if self.landed is LandedState.TAKEOFF and self.phase is not Phase.TAKEOFF and self._flown > 0:
            self.landed = LandedState.IN_AIR
        if event is MotionEvent.NEAR:
            self._release()
        elif event is MotionEvent.STALLED:
            self._give_up("cannot make progress: the wind is too strong for the vehicle")
        elif event is MotionEvent.ENERGY:
            self._deplete()

    def _leg_done(self, plan: Itinerary, leg: int, time_s: float) -> None:
        final = leg == len(plan.rows) - 1
        seq = plan.seqs[leg]
        if self.landed is LandedState.TAKEOFF:
            self.landed = LandedState.IN_AIR
        if not final:
            if plan.ending is Ending.TOUCHDOWN and plan.rows[leg + 1][4] < 0.0:
                self.landed = LandedState.LANDING
                if self.phase is Phase.RETURN:
                    self.phase = Phase.LAND
            if plan.done[leg]:
                self._next_leg(plan, leg, time_s)
            return
        if plan.ending is Ending.TOUCHDOWN:
            self._touch_down(seq)
        elif plan.ending is Ending.WAIT:
            self._timer = self.motion.step + round(plan.wait_s / self.motion.step_s)
            if plan.wait_s <= 0.0:
                self._timer = None
                self._complete_item()
        elif plan.ending is Ending.NEXT:
            if seq >= 0:
                self._complete_item()
            else:
                self._target_reached()

    def _next_leg(self, plan: Itinerary, leg: int, time_s: float) -> None:
        """Go on to the next item of the plan, unless what lies between changes the plan."""
        self._tell(ItemReached(time_s, plan.seqs[leg]))
        following = self._between(plan.seqs[leg] + 1, time_s)
        nearly_out = plan.open and leg >= len(plan.rows) - _REPLAN_BEFORE
        planned = plan.rows[leg + 1]
        same = following == plan.seqs[leg + 1] and abs(planned[4]) <= self._settings.speed_m_s == abs(planned[4])
        if same and not nearly_out and not self._waiting:
            self._set_current(following, time_s)
            return
        self._fly_from(following, time_s)

    def _complete_item(self) -> None:
        """The current item is complete: go on with the items after it."""
        seq = self.current_seq
        self._tell(ItemReached(self.time_s, seq))
        self._fly_from(self._between(seq + 1, self.time_s), self.time_s)

    def _continue(self, seq: int) -> None:
        time_s = self.time_s
        self._fly_from(self._between(seq, time_s), time_s)

    def _between(self, seq: int, time_s: float) -> int:
        """Execute the items from ``seq`` to the next place, which is returned; `_GAVE_UP` when there is none."""
        for waiting in self._waiting:
            self._execute(waiting, time_s)
        self._waiting = []
        self._waiting_step = None
        while True:
            done, following = do_items(self.items, seq, self._settings, self.spec.top_speed_m_s)
            for index in done:
                self._announce(index, time_s)
            if following < 0:
                self._give_up("jumps never lead to a place", seq)
                return _GAVE_UP
            if following >= len(self.items) or self.items[following].command not in CONDITIONS:
                break
            self._waiting = condition_items(self.items, following)
            seq = self._waiting[-1] + 1
        if self._waiting and following >= len(self.items):
            for waiting in self._waiting:
                self._execute(waiting, time_s)
            self._waiting = []
        return following

    def _announce(self, seq: int, time_s: float) -> None:
        item = self.items[seq]
        if item.command in CAMERA_COMMANDS:
            self._tell(CameraCommand(time_s, seq, item))
        self._tell(ItemReached(time_s, seq))

    def _execute(self, seq: int, time_s: float) -> None:
        """Execute one item that waited for a condition."""
        if self.items[seq].command not in CONDITIONS:
            do_items(self.items[: seq + 1], seq, self._settings, self.spec.top_speed_m_s)
        self._announce(seq, time_s)

    def _release(self) -> None:
        """The condition is met: execute what waited for it, up to the next condition."""
        time_s = self.time_s
        before = self._settings.copy()
        self._waiting_step = None
        self._execute(self._waiting.pop(0), time_s)
        # At the place itself, where a pause runs, there is no way left to wait on.
        while self._waiting and (self._timer is not None or not self._waits()):
            self._execute(self._waiting.pop(0), time_s)
        if self._timer is None and (self._waiting or self._settings != before):
            self._fly_from(self.current_seq, time_s)

    def _waits(self, command: int | None = None) -> bool:
        """Whether what comes next waits for a condition (for this one)."""
        if not self._waiting:
            return False
        first = self.items[self._waiting[0]].command
        return first in CONDITIONS if command is None else first == command

    def _fly_from(self, seq: int, time_s: float) -> None:
        """Plan the legs from a place item on and begin to fly them."""
        if seq == _GAVE_UP:
            return
        if seq >= len(self.items):
            self._finish(time_s)
            return
        self._set_current(seq, time_s)
        command = self.items[seq].command
        if self.landed is LandedState.ON_GROUND and command != Command.NAV_TAKEOFF:
            self._on_ground(seq)
            return
        if self._waits(Command.CONDITION_DELAY):
            delay = number(self.items[self._waiting[0]].param1)
            self._waiting_step = self.motion.step + max(1, round(delay / self.motion.step_s))
        here = self.motion.position_m
        if math.isnan(self._places[seq][0]) and command not in (Command.NAV_TAKEOFF, Command.NAV_RETURN_TO_LAUNCH):
            here = self.motion.stopping_point()
        self._begin(plan_item_legs(self.items, self._places, seq, self._settings.copy(), self.spec, here))

    def _on_ground(self, seq: int) -> None:
        """Do an item that is not a take-off on the ground: wait, be landed, or give up."""
        command = self.items[seq].command
        if command == Command.NAV_DELAY:
            self._plan = None
            self._timer = self.motion.step + max(1, round(number(self.items[seq].param1) / self.motion.step_s))
        elif command in (Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH):
            self._complete_item()
        else:
            self._give_up("the vehicle is on the ground: a take-off item must come first", seq)

    def _finish(self, time_s: float) -> None:
        self._tell(MissionComplete(time_s))
        if self.landed is LandedState.ON_GROUND:
            self._drop_plan(Phase.GROUND)
            self._disarm_later()
        else:
            self.hold()

    def _disarm_later(self) -> None:
        self._disarm_step = self.motion.step + round(self.spec.disarm_delay_s / self.motion.step_s)

    def _target_reached(self) -> None:
        if self.phase in (Phase.TAKEOFF, Phase.GOTO):
            self.phase = Phase.HOLD
            self._tell(TargetReached(self.time_s))

    def _give_up(self, reason: str, seq: int | None = None) -> None:
        on_mission = self.phase is Phase.MISSION
        self._tell(CannotFly(self.time_s, (self.current_seq if seq is None else seq) if on_mission else -1, reason))
        if self.phase is not Phase.DEPLETED:
            self.hold()
        if self.landed is LandedState.ON_GROUND:
            self._disarm_later()

    # Ground and battery ---------------------------------------------------------------------------------------------

    def _ground(self) -> None:
        self.motion.touch_down()
        self.landed = LandedState.ON_GROUND
        self._plan = None
        self._tell(Landed(self.time_s))

    def _touch_down(self, seq: int) -> None:
        was = self.phase
        self._ground()
        self._disarm_later()
        if was is Phase.DEPLETED:
            self._disarm_step = self.motion.step
        elif was is Phase.MISSION and seq >= 0:
            self._complete_item()
            if self.landed is not LandedState.ON_GROUND:
                self._disarm_step = None
            return
        self._drop_plan(Phase.GROUND)

    def _drain_on_ground(self) -> None:
        battery = self.spec.battery
        if self.armed and battery is not None and battery_state(battery, self.motion.energy_j, 0.0).depleted:
            self._tell(BatteryDepleted(self.time_s))
            self.armed = False
            self._drop_plan(Phase.GROUND)
            self._disarm_step = None
            self._tell(Disarmed(self.time_s))

    def _deplete(self) -> None:
        """Come down where it is: nothing else is possible any more."""
        self.motion.ignore_energy()
        self._tell(BatteryDepleted(self.time_s))
        x, y, _ = self.motion.stopping_point()
        rows = [(x, y, 0.0, 0.0, self.spec.cruise_speed_m_s, KEEP, 0.0)]
        self._fly(rows, Phase.DEPLETED, Ending.TOUCHDOWN)
        self.landed = LandedState.LANDING


def _motion(spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
    """Return the motion model of a vehicle; the compiled one is imported only where it is needed."""
    if spec.is_ideal:
        from sim_vehicle.motion.ideal import IdealRobot

        return IdealRobot(spec, yaw_rad)
    from sim_vehicle.motion.multirotor import Multirotor

    return Multirotor(spec, wind, yaw_rad)
