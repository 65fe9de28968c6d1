"""Carries out a mission over a motion model: legs, pauses, conditions, jumps, landing, empty battery."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.model import Command
from sim_vehicle.execution.items import (
    CAMERA_COMMANDS,
    CONDITIONS,
    PLACE_COMMANDS,
    Ending,
    Itinerary,
    Settings,
    condition_items,
    do_items,
    item_places,
    number,
    plan_item_legs,
    time_of_day_wait_s,
)
from sim_vehicle.execution.leg_follower import Craft
from sim_vehicle.execution.state import (
    CameraCommand,
    CannotFly,
    CurrentChanged,
    Disarmed,
    HomeMoved,
    ItemReached,
    LandedState,
    MissionComplete,
    Phase,
    TargetReached,
)
from sim_vehicle.motion.legs import ALONG, KEEP, Leg
from sim_vehicle.motion.model import MotionEvent

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from geo.frame import LocalFrame
    from mission.model import MissionItem
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position
    from sim_vehicle.weather.wind import Wind

_REPLAN_BEFORE = 64
_GAVE_UP = -2
_WAYPOINT = int(Command.NAV_WAYPOINT)
ROI_COMMANDS = frozenset({195, 197, 201})
EPOCH_UNIX_S = 1_780_315_200.0
"""Time of day at time 0 unless another is given: 2026-06-01T12:00:00Z."""


class MissionSequencer(Craft):
    """The inner part of a `sim_vehicle.execution.executor.MissionExecutor`: what follows from what."""

    def __init__(
        self, spec: VehicleSpec, frame: LocalFrame, *, wind: Wind | None = None, yaw_rad: float = 0.0
    ) -> None:
        super().__init__(spec, frame, wind=wind, yaw_rad=yaw_rad)
        self.items: tuple[MissionItem, ...] = ()
        self.current_seq = -1
        self.takes_off = False
        self.epoch_unix_s = EPOCH_UNIX_S
        self._places: list[Position] = []
        self._settings = Settings(spec.cruise_speed_m_s, default_m_s=spec.cruise_speed_m_s)
        self._waiting: list[int] = []
        self._waiting_step: int | None = None
        self._replan = False

    def load(
        self, items: Sequence[MissionItem], places: list[Position] | None = None, current: int = 0
    ) -> None:
        """Replace the mission, to begin at an item; a vehicle that is flying one holds.

        ``places`` are those of `sim_vehicle.execution.items.item_places`, when they are known already.
        """
        if self.phase is Phase.MISSION:
            self.hold()
        self.items = tuple(items)
        self._places = item_places(self.items, self.frame) if places is None else places
        self._settings = Settings(self.spec.cruise_speed_m_s, default_m_s=self.spec.cruise_speed_m_s)
        self.current_seq = min(current, len(self.items) - 1)
        self.look_at(None)

    def _drop_plan(self, phase: Phase) -> None:
        super()._drop_plan(phase)
        self._waiting = []
        self._waiting_step = None

    def _begin(self, plan: Itinerary) -> None:
        if self._waits(Command.CONDITION_DISTANCE):
            near = max(number(self.items[self._waiting[0]].param1), 1e-3)
            plan.legs[0] = replace(plan.legs[0], near_m=near)
        super()._begin(plan)

    def _set_current(self, seq: int, time_s: float | None = None) -> None:
        if seq != self.current_seq:
            self.current_seq = seq
            self._tell(CurrentChanged(self.time_s if time_s is None else time_s, seq))

    def _run(self, target: int, *, stop_each: bool) -> None:
        course = self._course(target, stop_each=stop_each)
        advance = self.motion.advance
        try:
            steps, closely = next(course)
            while True:
                steps, closely = course.send(advance(steps, stop_each=closely))
        except StopIteration:
            return

    def _course(self, target: int, *, stop_each: bool) -> Generator[tuple[int, bool], MotionEvent, None]:
        """Fly until a step; who sends back its event moves the vehicle: up to how far, and how closely."""
        motion = self.motion
        while motion.step < target:
            limit = target
            for step in (self._timer, self._disarm_step, self._waiting_step):
                if step is not None and step < limit:
                    limit = max(step, motion.step)
            flying = self._plan is not None and self.landed is not LandedState.ON_GROUND
            if flying:
                closely = stop_each or self._plan_needs_care()
                event = yield limit - motion.step, closely
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
        return (
            self.phase is not Phase.MISSION
            and self._disarm_step is None
            and (self.landed is LandedState.ON_GROUND or self.phase is Phase.HOLD)
        )

    def _stuck(self) -> bool:
        """Whether the mission stays where it is for ever."""
        plan = self._plan
        return plan is not None and plan.ending is Ending.FOREVER and self._flown == len(plan.legs)

    def _plan_needs_care(self) -> bool:
        """Whether legs have to be looked at one by one even in a prediction."""
        plan = self._plan
        return bool(self._waiting) or (plan is not None and (plan.open or plan.unsure))

    def _account(self, event: MotionEvent) -> None:
        """Complete the legs that were flown, and take what ended the motion."""
        plan = self._plan
        self._complete_legs()
        if event is MotionEvent.ENERGY:
            if self.landed is not LandedState.ON_GROUND:
                self._deplete()
        elif self._plan is plan:
            if event is MotionEvent.NEAR:
                self._release()
            elif event is MotionEvent.STALLED:
                self._give_up("cannot make progress: the wind is too strong for the vehicle")

    def _complete_legs(self) -> None:
        plan, motion = self._plan, self.motion
        assert plan is not None
        reached = motion.leg + (1 if motion.arrivals[motion.leg] >= 0 else 0)
        while self._flown < reached and self._plan is plan:
            leg = self._flown
            self._flown += 1
            self._leg_done(plan, leg, int(motion.arrivals[leg]) * motion.step_s)

    def _leg_done(self, plan: Itinerary, leg: int, time_s: float) -> None:
        final = leg == len(plan.legs) - 1
        seq = plan.seqs[leg]
        if self.landed is LandedState.TAKEOFF:
            self.landed = LandedState.IN_AIR
        if not final:
            if plan.ending is Ending.TOUCHDOWN and plan.legs[leg + 1].descends:
                self._descend()
            if plan.done[leg]:
                self._next_leg(plan, leg, time_s)
            return
        if plan.ending is Ending.TOUCHDOWN:
            self._touch_down(seq)
        elif plan.ending is Ending.WAIT:
            wait_s = self._delay_s(seq) if math.isnan(plan.wait_s) else plan.wait_s
            self._timer = self.motion.step + round(wait_s / self.motion.step_s)
            if wait_s <= 0.0:
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
        nearly_out = plan.open and leg >= len(plan.legs) - _REPLAN_BEFORE
        same = following == plan.seqs[leg + 1] and plan.speeds[leg + 1] == self._settings.speed_m_s
        if same and not nearly_out and not self._waiting and not self._replan:
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
        """Execute the items from ``seq`` to the next place and return it; `_GAVE_UP` when there is none."""
        self._settings.heading = ALONG
        if self._waiting:
            for waiting in self._waiting:
                self._execute(waiting, time_s)
            self._waiting = []
            self._waiting_step = None
        if seq < len(self.items) and self.items[seq].command == _WAYPOINT:
            return seq
        self._settings.yaw_rad = self.motion.snapshot().heading_rad
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
        command = item.command
        if command in CAMERA_COMMANDS:
            self._tell(CameraCommand(time_s, seq, item))
        elif command in ROI_COMMANDS:
            x, y, _ = self._places[seq]
            self.look_at(None if math.isnan(x) else (x, y))
        elif command == Command.DO_SET_HOME:
            here = self.motion.position_m[:2] if number(item.param1) == 1.0 else self._places[seq][:2]
            if not math.isnan(here[0]):
                self.home_m = here
                self._tell(HomeMoved(time_s, *here))
        elif command == Command.CONDITION_YAW:
            self._replan |= number(item.param4) != 0.0
        elif command == Command.DO_CHANGE_SPEED:
            self._replan |= number(item.param1) > 1.0
        self._tell(ItemReached(time_s, seq))

    def _execute(self, seq: int, time_s: float) -> None:
        """Execute one item that waited for a condition."""
        if self.items[seq].command not in CONDITIONS:
            self._settings.yaw_rad = self.motion.snapshot().heading_rad
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
        drives = self.spec.kind == "rover"
        climbs = self.landed is LandedState.ON_GROUND and command != Command.NAV_TAKEOFF and not drives
        if climbs and not (self.takes_off and command in PLACE_COMMANDS):
            self._on_ground(seq)
            return
        if self._waits(Command.CONDITION_DELAY):
            delay = number(self.items[self._waiting[0]].param1)
            self._waiting_step = self.motion.step + max(1, round(delay / self.motion.step_s))
        here = self.motion.position_m
        if math.isnan(self._places[seq][0]) and command not in (
            Command.NAV_TAKEOFF,
            Command.NAV_RETURN_TO_LAUNCH,
        ):
            here = self.motion.stopping_point()
        self._replan = False
        self.motion.set_climb(self._settings.climb_m_s, self._settings.descent_m_s)
        if command in (Command.NAV_RETURN_TO_LAUNCH, Command.NAV_LAND):
            self.look_at(None)
        if climbs:
            here = (here[0], here[1], max(self._places[seq][2], self.spec.takeoff_altitude_m))
        plan = plan_item_legs(
            self.items, self._places, seq, self._settings.copy(), self.spec, here, self.haven()
        )
        if climbs:
            plan.prepend(Leg(here, self._settings.speed_m_s, self.spec.acceptance_radius_m, KEEP), seq)
        self._begin(plan)

    def _on_ground(self, seq: int) -> None:
        """Do an item that is not a take-off on the ground: wait, be landed, or give up."""
        command = self.items[seq].command
        if command == Command.NAV_DELAY:
            self._plan = None
            self._timer = self.motion.step + max(1, round(self._delay_s(seq) / self.motion.step_s))
        elif command in (Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH):
            self._complete_item()
        else:
            self._give_up("the vehicle is on the ground: a take-off item must come first", seq)

    def _delay_s(self, seq: int) -> float:
        item = self.items[seq]
        delay_s = number(item.param1)
        return delay_s if delay_s >= 0.0 else time_of_day_wait_s(item, self.epoch_unix_s + self.time_s)

    def _finish(self, time_s: float) -> None:
        self._tell(MissionComplete(time_s))
        if self.landed is LandedState.ON_GROUND:
            self._drop_plan(Phase.GROUND)
            self._disarm_later()
        else:
            self.hold()

    def _target_reached(self) -> None:
        if self.phase in (Phase.TAKEOFF, Phase.GOTO):
            self.phase = Phase.HOLD
            self._tell(TargetReached(self.time_s))

    def _give_up(self, reason: str, seq: int | None = None) -> None:
        on_mission = self.phase is Phase.MISSION
        self._tell(
            CannotFly(self.time_s, (self.current_seq if seq is None else seq) if on_mission else -1, reason)
        )
        if not self.phase.is_lost:
            self.hold()
        if self.landed is LandedState.ON_GROUND:
            self._disarm_later()

    def _touch_down(self, seq: int) -> None:
        was = self.phase
        self._ground()
        self._disarm_later()
        if was.is_lost:
            self._disarm_step = self.motion.step
        elif was is Phase.MISSION and seq >= 0:
            self._complete_item()
            if self.landed is not LandedState.ON_GROUND:
                self._disarm_step = None
            return
        self._drop_plan(Phase.GROUND)
