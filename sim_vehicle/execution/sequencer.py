"""Mission sequence: legs, pauses, conditions, jumps, landings, and an empty battery."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mission.model import Command
from sim_vehicle.execution.item_legs import plan_item_legs
from sim_vehicle.execution.items import (
    CONDITIONS,
    EXTRA_COMMANDS,
    PASSED_COMMANDS,
    PLACED_COMMANDS,
    POSITION_COMMANDS,
    ROI_COMMANDS,
    Settings,
    climb_leg,
    condition_items,
    do_items,
    item_positions,
    landing_restart,
    landing_start,
    number,
    time_of_day_wait_s,
)
from sim_vehicle.execution.leg_follower import AfterLastLeg, LegFollower, LegPlan, Waiting, require
from sim_vehicle.execution.state import (
    EPOCH_UNIX_S,
    CameraCommand,
    CannotFly,
    CurrentChanged,
    Disarmed,
    FlightPhase,
    HomeMoved,
    ItemReached,
    LandedState,
    LandingRestarted,
    MissionComplete,
    TargetReached,
)
from sim_vehicle.motion.legs import ALONG, KEEP, Leg, LegKind
from sim_vehicle.motion.model import MotionEvent

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from geo.frame import LocalFrame
    from mission.model import MissionItem
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position

# Number of legs left at which a plan that was cut short is extended, before the vehicle brakes.
_REPLAN_BEFORE = 64
_CANNOT_FLY = -2
_LANDING_COMMANDS = frozenset({16, 18, 19, 21, 31})
_WAYPOINT = int(Command.NAV_WAYPOINT)
_TRIGGERS = frozenset({206, 214, 2000, 2001, 2003})


@dataclass(slots=True)
class ReturnPoints:
    """Return destinations: home and the rally points."""

    home_m: Position = (0.0, 0.0, 0.0)
    """Position of home relative to the start: east, north, up."""
    rally_m: tuple[Position, ...] = ()
    """Rally points: east, north, and the minimum height of the path to the point."""

    def nearest(self, position_m: Position) -> Position:
        """Return the point nearest to a position: east, north, and the minimum height of the path there.

        Examples
        --------
        >>> points = ReturnPoints(rally_m=((100.0, 0.0, 30.0),))
        >>> points.nearest((20.0, 0.0, 5.0)), points.nearest((80.0, 0.0, 5.0))
        ((0.0, 0.0, 0.0), (100.0, 0.0, 30.0))
        """
        x, y, _ = position_m
        points = ((*self.home_m[:2], 0.0), *self.rally_m)
        return min(points, key=lambda point: math.hypot(point[0] - x, point[1] - y))


class MissionSequencer:
    """Sequencer that flies the items of a mission in order, as legs of a `LegFollower`.

    With `takes_off`, a mission that begins on the ground without a take-off item climbs first, as in PX4. The
    climb ends at the height of the first position, or at the take-off altitude if this is higher.
    `epoch_unix_s` is the Unix time at simulated time 0. `current_seq` is the index of the present or next
    item, -1 without a mission. `settings` has the speeds and heading of later legs.
    """

    def __init__(
        self,
        flight: LegFollower,
        frame: LocalFrame,
        *,
        takes_off: bool = False,
        epoch_unix_s: float = EPOCH_UNIX_S,
    ) -> None:
        self.flight = flight
        self._motion = flight.motion
        self.frame = frame
        self.takes_off = takes_off
        self.epoch_unix_s = epoch_unix_s
        self.items: tuple[MissionItem, ...] = ()
        self.current_seq = -1
        self.settings = self._default_settings()
        self.return_points = ReturnPoints()
        self._positions: list[Position] = []
        self._replan = False
        self._resume_at: int | None = None

    def load(
        self,
        items: Sequence[MissionItem],
        positions: list[Position] | None = None,
        current: int = 0,
        *,
        keeps_settings: bool = False,
    ) -> None:
        """Replace the mission, with `current` as its current item; a vehicle that is flying a mission holds.

        `positions` is the result of `sim_vehicle.execution.items.item_positions`, if the caller has it. With
        `keeps_settings`, the vehicle keeps its present speeds.
        """
        if self.flight.phase is FlightPhase.MISSION:
            self.flight.hold()
        self._take(items, positions)
        self.current_seq = min(current, len(self.items) - 1)
        if not keeps_settings:
            self.settings = self._default_settings()
            self.flight.look_at(None)

    def change(
        self, items: Sequence[MissionItem], seq: int, *, at_waypoints: bool = False, keeps_jumps: bool = False
    ) -> bool:
        """Replace the mission in flight, go on at item `seq`, and return whether the vehicle turns at once.

        The vehicle keeps its speeds. A vehicle in a take-off item completes the climb first. A vehicle in a
        return item completes the return, and the mission ends. A mission without item `seq` ends, too. With
        `at_waypoints`, the vehicle turns at once only if the old item is a waypoint and item `seq` exists;
        otherwise it completes the old item, then the next. With `keeps_jumps`, jump counters stay unchanged.
        """
        self.flight.ready("change the mission")
        flown = self.items[self.current_seq].command if self.current_seq < len(self.items) else _WAYPOINT
        self._take(items)
        if not keeps_jumps:
            self.settings.jumps.clear()
        if self.flight.phase is FlightPhase.MISSION and self.flight.landed is not LandedState.ON_GROUND:
            completes = at_waypoints and (flown not in PASSED_COMMANDS or seq >= len(self.items))
            if flown == Command.NAV_RETURN_TO_LAUNCH:
                self._resume_at = len(self.items)
            elif not completes and self.flight.landed is LandedState.TAKEOFF:
                self._resume_at = seq
            if completes or self._resume_at is not None:
                # The vehicle follows the plan of the old mission only to the end of the present item.
                self.flight.waiting = Waiting()
                self._replan = True
                return False
        self._motion.interrupt()
        self.begin_at(seq)
        return True

    def _take(self, items: Sequence[MissionItem], positions: list[Position] | None = None) -> None:
        self.items = tuple(items)
        self._positions = positions if positions is not None else self._item_positions()
        self._resume_at = None

    def _item_positions(self) -> list[Position]:
        return item_positions(self.items, self.frame, self.return_points.home_m[2])

    def move_home(self, home_m: Position) -> None:
        """Move home; from the next leg on, altitudes above home count from the new home."""
        moves = home_m[2] != self.return_points.home_m[2]
        self.return_points.home_m = home_m
        if moves:
            self._positions = self._item_positions()

    def spec_about_home(self, spec: VehicleSpec) -> VehicleSpec:
        """Return `spec` with its return altitude converted: from above home to above the start."""
        up_m = self.return_points.home_m[2]
        return spec if up_m == 0.0 else replace(spec, return_altitude_m=spec.return_altitude_m + up_m)

    def return_point(self) -> Position:
        """Return the destination of a return from here, and the minimum height of the path to it."""
        return self.return_points.nearest(self._motion.position_m)

    def _default_settings(self) -> Settings:
        speed_m_s = self.flight.spec.cruise_speed_m_s
        return Settings(speed_m_s, default_m_s=speed_m_s)

    def _set_current(self, seq: int, time_s: float | None = None) -> None:
        if seq != self.current_seq:
            self.current_seq = seq
            self.flight.emit(CurrentChanged(self.flight.time_s if time_s is None else time_s, seq))

    def begin_at(self, seq: int) -> None:
        """Begin or resume the mission at an item."""
        self.flight.disarm_step = None
        self.flight.drop_plan(FlightPhase.MISSION)
        self._resume_at = None
        self._continue(seq)

    def set_current(self, seq: int) -> None:
        """Make an item the current item; a vehicle that flies the mission turns to it at once."""
        count = len(self.items)
        require(0 <= seq < count, f"mission item {seq}: the mission has {count} items")
        self.settings.jumps.clear()
        self._set_current(seq)
        if self.flight.phase is FlightPhase.MISSION:
            self._motion.interrupt()
            self.begin_at(seq)

    def reset_speed(self) -> None:
        """Reset the ground speed of later legs to the vehicle's default."""
        self.settings.speed_m_s = self.flight.spec.cruise_speed_m_s

    def replay_speed(self) -> None:
        """Set the ground speed of later legs to the speed set by the items before the current item."""
        settings = self._default_settings()
        for seq, item in enumerate(self.items[: max(self.current_seq, 0)]):
            if item.command == Command.DO_CHANGE_SPEED:
                do_items(self.items[: seq + 1], seq, settings, self.flight.spec.top_speed_m_s)
        self.settings.speed_m_s = settings.speed_m_s

    def rewind_survey(self) -> None:
        """Step back to the position before an interrupted leg if the leg was triggering the camera.

        Source: ``MissionBase::on_activation`` and ``getPreviousPositionItems`` of PX4 v1.17.
        """
        before = self.items[: max(self.current_seq, 0)]
        triggers = [item for item in before if item.command in _TRIGGERS]
        positions = [seq for seq, item in enumerate(before[:-1]) if item.command in PLACED_COMMANDS]
        if not triggers or not positions or triggers[-1].command == Command.IMAGE_STOP_CAPTURE:
            return
        if triggers[-1].command == Command.IMAGE_START_CAPTURE or number(triggers[-1].param1) > 0.0:
            self._set_current(positions[-1])

    def apply_speed(self) -> None:
        """Apply a changed ground speed to the legs that the vehicle now flies."""
        speed_m_s = self.settings.speed_m_s
        plan = self.flight.plan
        if self.flight.phase is FlightPhase.STEERED or plan is None or self.flight.timer is not None:
            return
        if self.flight.phase is FlightPhase.MISSION:
            if self._resume_at is None and self.current_seq < len(self.items):
                self._fly_from(self.current_seq, self.flight.time_s)
        elif self.flight.phase in (FlightPhase.GOTO, FlightPhase.RETURN):
            left = plan.legs[self.flight.flown :]
            legs = [leg if leg.descends else replace(leg, speed_m_s=speed_m_s) for leg in left]
            self.flight.fly(legs, self.flight.phase, plan.after_last)

    @property
    def returns(self) -> bool:
        """Whether the vehicle is flying a return to launch that is the last mission item."""
        on_mission = self.flight.phase is FlightPhase.MISSION and self.current_seq == len(self.items) - 1
        return on_mission and self.items[self.current_seq].command == Command.NAV_RETURN_TO_LAUNCH

    def leave_to_return(self) -> None:
        """Leave the mission during its return item, and continue this return outside the mission."""
        self.flight.phase = (
            FlightPhase.LAND if self.flight.landed is LandedState.LANDING else FlightPhase.RETURN
        )

    @property
    def lands(self) -> bool:
        """Whether the vehicle is flying a landing item of the mission."""
        on_mission = self.flight.phase is FlightPhase.MISSION and 0 <= self.current_seq < len(self.items)
        return on_mission and self.items[self.current_seq].command == Command.NAV_LAND

    @property
    def goes_around(self) -> bool:
        """Whether the vehicle is climbing after an aborted landing."""
        plan = self.flight.plan
        return self.lands and plan is not None and plan.legs[0].kind is LegKind.TAKEOFF

    def go_around(self, height_m: float | None = None) -> float:
        """Abort the landing: climb straight ahead, then restart the landing; return the height of the climb.

        By default the climb ends at the height in parameter 1 of the landing item, or at the take-off height.
        """
        self.flight.ready("go around")
        able = self.lands and self.flight.landed is not LandedState.ON_GROUND
        require(able, "cannot go around: the vehicle is not flying a landing of the mission")
        leg = climb_leg(
            self.items, self.current_seq, self._motion.position_m, self.settings.speed_m_s, height_m
        )
        plan = LegPlan()
        plan.add(leg, self.current_seq)
        self.flight.disarm_step = None
        self._motion.interrupt()
        self.flight.begin(plan)
        return leg.end_m[2]

    def landing_start(self) -> int | None:
        """Return the nearest DO_LAND_START item, or None if the mission has none."""
        return landing_start(self.items, self._positions, self._motion.position_m)

    def landing_legs(self) -> list[Leg]:
        """Return the legs of the mission's landing from here; no legs if the landing is incomplete."""
        seq = self.landing_start()
        if seq is None:
            return []
        here = self._motion.position_m
        legs: list[Leg] = []
        settings = self.settings.copy()
        while True:
            _, seq = do_items(self.items, seq, settings, self.flight.spec.top_speed_m_s)
            if not 0 <= seq < len(self.items) or self.items[seq].command not in _LANDING_COMMANDS:
                return []
            plan = self._plan(seq, settings, here)
            legs += plan.legs
            here = legs[-1].end_m
            if plan.after_last is AfterLastLeg.TOUCHDOWN:
                return legs
            seq = plan.seqs[-1] + 1

    def _plan(self, seq: int, settings: Settings, here: Position) -> LegPlan:
        spec, home = self.spec_about_home(self.flight.spec), self.return_point()
        return plan_item_legs(self.items, self._positions, seq, settings, spec, here, home)

    def run(self, target: int, *, stop_each: bool) -> None:
        """Fly until a motion step."""
        course = self.course(target, stop_each=stop_each)
        with suppress(StopIteration):
            steps, closely = next(course)
            while True:
                steps, closely = course.send(self._motion.advance(steps, stop_each=closely))

    def course(self, target: int, *, stop_each: bool) -> Generator[tuple[int, bool], MotionEvent, None]:
        """Fly until a motion step, while the caller advances the motion.

        This coroutine yields ``(max_steps, stop_each)``. The caller advances the motion with these arguments
        and sends the MotionEvent back. Without `stop_each`, the coroutine ends when the mission is over.
        """
        motion = self._motion
        while motion.step < target:
            limit = target
            for step in (self.flight.timer, self.flight.disarm_step, self.flight.waiting.step):
                if step is not None and step < limit:
                    limit = max(step, motion.step)
            plan = self.flight.plan
            if plan is not None and self.flight.landed is not LandedState.ON_GROUND:
                closely = stop_each or bool(self.flight.waiting.seqs) or plan.open or plan.unsure
                event = yield limit - motion.step, closely
                self._account(event)
            elif limit > motion.step:
                motion.rest(limit - motion.step, armed=self.flight.armed)
                self.flight.drain_on_ground()
            if self.flight.timer is not None and motion.step >= self.flight.timer:
                self.flight.timer = None
                self._complete_item()
            if self.flight.waiting.step is not None and motion.step >= self.flight.waiting.step:
                self._release()
            if self.flight.disarm_step is not None and motion.step >= self.flight.disarm_step:
                self.flight.stop_motors()
                self.flight.emit(Disarmed(self.flight.time_s))
            if not stop_each and self._over():
                return

    def _over(self) -> bool:
        """Whether the mission is over or the vehicle holds forever."""
        plan = self.flight.plan
        forever = plan is not None and plan.after_last is AfterLastLeg.FOREVER
        if plan is not None and forever and self.flight.flown == len(plan.legs):
            return True
        rests = self.flight.landed is LandedState.ON_GROUND or self.flight.phase is FlightPhase.HOLD
        return rests and self.flight.phase is not FlightPhase.MISSION and self.flight.disarm_step is None

    def _account(self, event: MotionEvent) -> None:
        """Complete the legs that the vehicle has flown, and handle the event at which the motion stopped."""
        plan, motion = self.flight.plan, self._motion
        assert plan is not None
        reached = motion.leg + (1 if motion.arrivals[motion.leg] >= 0 else 0)
        while self.flight.flown < reached and self.flight.plan is plan:
            leg = self.flight.flown
            self.flight.flown += 1
            self._leg_done(plan, leg, int(motion.arrivals[leg]) * motion.step_s)
        if event is MotionEvent.ENERGY:
            if self.flight.landed is not LandedState.ON_GROUND:
                self.flight.deplete()
        elif self.flight.plan is plan:
            if event is MotionEvent.NEAR:
                self._release()
            elif event is MotionEvent.STALLED:
                self._cannot_fly("cannot make progress: the wind is too strong for the vehicle")

    def _leg_done(self, plan: LegPlan, leg: int, time_s: float) -> None:
        final = leg == len(plan.legs) - 1
        seq = plan.seqs[leg]
        climbed = self.flight.landed is LandedState.TAKEOFF
        if climbed:
            self.flight.landed = LandedState.IN_AIR
        if climbed and self._resume_at is not None and not plan.done[leg] and seq >= 0:
            self._continue(self._following(seq - 1))
            return
        if self.goes_around:
            at = landing_restart(self.items, self._positions, seq, self._motion.position_m)
            if at is None:
                self._cannot_fly("unable to restart the landing sequence", seq)
                return
            self.flight.emit(LandingRestarted(time_s, at))
            self._continue(at)
            return
        if not final:
            if plan.after_last is AfterLastLeg.TOUCHDOWN and plan.legs[leg + 1].descends:
                self.flight.descend()
            if plan.done[leg]:
                self._next_leg(plan, leg, time_s)
            return
        if plan.after_last is AfterLastLeg.TOUCHDOWN:
            self._on_touch_down(seq)
        elif plan.after_last is AfterLastLeg.WAIT:
            wait_s = self._delay_s(seq) if math.isnan(plan.wait_s) else plan.wait_s
            self.flight.timer = self._motion.step + round(wait_s / self._motion.step_s)
            if wait_s <= 0.0:
                self.flight.timer = None
                self._complete_item()
        elif plan.after_last is AfterLastLeg.NEXT:
            if seq >= 0:
                self._complete_item()
            elif self.flight.phase in (FlightPhase.TAKEOFF, FlightPhase.GOTO):
                self.flight.phase = FlightPhase.HOLD
                self.flight.emit(TargetReached(self.flight.time_s))

    def _next_leg(self, plan: LegPlan, leg: int, time_s: float) -> None:
        """Continue with the next item of the plan, or plan again if commands before that item require it."""
        self.flight.emit(ItemReached(time_s, plan.seqs[leg]))
        following = self._between(self._following(plan.seqs[leg]), time_s)
        nearly_out = plan.open and leg >= len(plan.legs) - _REPLAN_BEFORE
        same = following == plan.seqs[leg + 1] and plan.speeds[leg + 1] == self.settings.speed_m_s
        if same and not nearly_out and not self.flight.waiting.seqs and not self._replan:
            self._set_current(following, time_s)
            return
        self._fly_from(following, time_s)

    def _complete_item(self) -> None:
        """Complete the current item and continue with the next items."""
        seq = self.current_seq
        self.flight.emit(ItemReached(self.flight.time_s, seq))
        self._fly_from(self._between(self._following(seq), self.flight.time_s), self.flight.time_s)

    def _following(self, seq: int) -> int:
        """Return the item after `seq` or, if the mission changed in flight, the item at which to go on."""
        at, self._resume_at = self._resume_at, None
        if at is None:
            return seq + 1
        took_off = at == seq and at < len(self.items) and self.items[at].command == Command.NAV_TAKEOFF
        return seq + 1 if took_off else at

    def _continue(self, seq: int) -> None:
        time_s = self.flight.time_s
        self._fly_from(self._between(seq, time_s), time_s)

    def _between(self, seq: int, time_s: float) -> int:
        """Execute the items up to the next item with a position, and return that item or `_CANNOT_FLY`."""
        self.settings.heading = ALONG
        if self.flight.waiting.seqs:
            self._execute_waiting(time_s)
            self.flight.waiting.step = None
        if seq < len(self.items) and self.items[seq].command == _WAYPOINT:
            return seq
        self.settings.yaw_rad = self._motion.snapshot().heading_rad
        while True:
            done, following = do_items(self.items, seq, self.settings, self.flight.spec.top_speed_m_s)
            for index in done:
                self._announce(index, time_s)
            if following < 0:
                self._cannot_fly("jumps never lead to a position", seq)
                return _CANNOT_FLY
            if following >= len(self.items) or self.items[following].command not in CONDITIONS:
                break
            self.flight.waiting.seqs = condition_items(self.items, following)
            seq = self.flight.waiting.seqs[-1] + 1
        if following >= len(self.items):
            self._execute_waiting(time_s)
        return following

    def _execute_waiting(self, time_s: float) -> None:
        for seq in self.flight.waiting.seqs:
            self._execute(seq, time_s)
        self.flight.waiting.seqs = []

    def _announce(self, seq: int, time_s: float) -> None:
        item = self.items[seq]
        command = item.command
        if command in EXTRA_COMMANDS:
            self.flight.emit(CameraCommand(time_s, seq, item))
        if command in ROI_COMMANDS:
            x, y, _ = self._positions[seq]
            self.flight.look_at(None if math.isnan(x) else (x, y))
        elif command == Command.DO_SET_HOME:
            home_m = self._motion.position_m if number(item.param1) == 1.0 else self._positions[seq]
            if not math.isnan(sum(home_m)):
                self.move_home(home_m)
                self.flight.emit(HomeMoved(time_s, *home_m[:2]))
        elif command == Command.CONDITION_YAW:
            self._replan |= number(item.param4) != 0.0
        elif command == Command.DO_CHANGE_SPEED:
            self._replan |= number(item.param1) > 1.0
        self.flight.emit(ItemReached(time_s, seq))

    def _execute(self, seq: int, time_s: float) -> None:
        """Execute an item whose condition is met."""
        if self.items[seq].command not in CONDITIONS:
            self.settings.yaw_rad = self._motion.snapshot().heading_rad
            do_items(self.items[: seq + 1], seq, self.settings, self.flight.spec.top_speed_m_s)
        self._announce(seq, time_s)

    def _release(self) -> None:
        """Execute the items whose condition is met, and stop at the next condition."""
        time_s = self.flight.time_s
        before = self.settings.copy()
        self.flight.waiting.step = None
        self._execute(self.flight.waiting.seqs.pop(0), time_s)
        # During a pause the vehicle is already at the position, so it meets further conditions at once.
        while self.flight.waiting.seqs and (self.flight.timer is not None or not self._waits()):
            self._execute(self.flight.waiting.seqs.pop(0), time_s)
        if self.flight.timer is None and (self.flight.waiting.seqs or self.settings != before):
            self._fly_from(self.current_seq, time_s)

    def _waits(self, command: int | None = None) -> bool:
        """Whether the next items wait for any condition, or for the condition `command` if it is given."""
        if not self.flight.waiting.seqs:
            return False
        first = self.items[self.flight.waiting.seqs[0]].command
        return first in CONDITIONS if command is None else first == command

    def _fly_from(self, seq: int, time_s: float) -> None:
        """Plan and begin the legs from an item that has a position."""
        if seq == _CANNOT_FLY:
            return
        if seq >= len(self.items):
            self.flight.emit(MissionComplete(time_s))
            if self.flight.landed is LandedState.ON_GROUND:
                self.flight.drop_plan(FlightPhase.GROUND)
                self.flight.disarm_later()
            else:
                self.flight.hold()
            return
        self._set_current(seq, time_s)
        command = self.items[seq].command
        stands = self.flight.landed is LandedState.ON_GROUND and not self.flight.spec.drives
        climbs = stands and command != Command.NAV_TAKEOFF
        if climbs and not (self.takes_off and command in POSITION_COMMANDS):
            self._on_ground(seq)
            return
        if self._waits(Command.CONDITION_DELAY):
            delay = number(self.items[self.flight.waiting.seqs[0]].param1)
            self.flight.waiting.step = self._motion.step + max(1, round(delay / self._motion.step_s))
        here = self._motion.position_m
        if math.isnan(self._positions[seq][0]) and command not in (
            Command.NAV_TAKEOFF,
            Command.NAV_RETURN_TO_LAUNCH,
        ):
            here = self._motion.stopping_point()
        self._replan = False
        self._motion.set_climb(self.settings.climb_m_s, self.settings.descent_m_s)
        if command in (Command.NAV_RETURN_TO_LAUNCH, Command.NAV_LAND):
            self.flight.look_at(None)
        if climbs:
            here = (here[0], here[1], max(self._positions[seq][2], self.flight.spec.takeoff_altitude_m))
        plan = self._plan(seq, self.settings.copy(), here)
        if climbs:
            plan.prepend(Leg(here, self.settings.speed_m_s, self.flight.spec.acceptance_radius_m, KEEP), seq)
        if self._waits(Command.CONDITION_DISTANCE):
            near = max(number(self.items[self.flight.waiting.seqs[0]].param1), 1e-3)
            plan.legs[0] = replace(plan.legs[0], near_m=near)
        self.flight.begin(plan)

    def _on_ground(self, seq: int) -> None:
        """On the ground, execute an item other than a take-off: wait, complete a landing, or fail."""
        command = self.items[seq].command
        if command == Command.NAV_DELAY:
            self.flight.plan = None
            self.flight.timer = self._motion.step + max(1, round(self._delay_s(seq) / self._motion.step_s))
        elif command in (Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH):
            self._complete_item()
        else:
            self._cannot_fly("the vehicle is on the ground: a take-off item must come first", seq)

    def _delay_s(self, seq: int) -> float:
        item = self.items[seq]
        delay_s = number(item.param1)
        if delay_s >= 0.0:
            return delay_s
        return time_of_day_wait_s(item, self.epoch_unix_s + self.flight.time_s)

    def _cannot_fly(self, reason: str, seq: int | None = None) -> None:
        on_mission = self.flight.phase is FlightPhase.MISSION
        at = self.current_seq if seq is None else seq
        self.flight.emit(CannotFly(self.flight.time_s, at if on_mission else -1, reason))
        if not self.flight.phase.is_lost:
            self.flight.hold()
        if self.flight.landed is LandedState.ON_GROUND:
            self.flight.disarm_later()

    def _on_touch_down(self, seq: int) -> None:
        was = self.flight.phase
        self.flight.touch_down()
        self.flight.disarm_later()
        if was.is_lost:
            self.flight.disarm_step = self._motion.step
        elif was is FlightPhase.MISSION and seq >= 0:
            self._complete_item()
            if self.flight.landed is not LandedState.ON_GROUND:
                self.flight.disarm_step = None
            return
        self.flight.drop_plan(FlightPhase.GROUND)
