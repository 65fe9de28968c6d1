"""Autopilot without MAVLink: orders, reactions to flight events, and the outcome of the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mission.model import Command, MissionItem
from mission.outcome import Outcome
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.behaviour import Action, Mode
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.items import item_positions
from sim_vehicle.execution.state import (
    EPOCH_UNIX_S,
    BatteryDepleted,
    CannotFly,
    Disarmed,
    FlightEvent,
    Landed,
    LandedState,
    LandingRestarted,
    MissionComplete,
    TargetReached,
)
from sim_vehicle.motion.legs import ALONG, Heading
from sim_vehicle.pilot.controls import Controls, RefusedError, Severity
from sim_vehicle.pilot.failsafe import ArmingChecks, Failsafe, IdleWatch, Reaction
from sim_vehicle.pilot.fence import Fence
from sim_vehicle.pilot.mode_control import MissionChange, MissionStatus, ModeControl, PilotExtra

if TYPE_CHECKING:
    from geo.frame import LocalFrame
    from sim_vehicle.airframe.navigation_errors import EstimateErrors
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot import Firmware
    from sim_vehicle.autopilot.stick_rules import Sticks
    from sim_vehicle.execution.items import ItemProblem
    from sim_vehicle.weather.wind import Wind

# Modes that end on the ground; the autopilot then disarms without delay.
_LANDS = (Mode.MISSION, Mode.RTL, Mode.LAND)
_MODES = {Action.HOLD: Mode.HOLD, Action.RETURN: Mode.RTL, Action.LAND: Mode.LAND}


class Pilot(Controls):
    """One vehicle that a firmware flies and that obeys orders.

    An order that the vehicle cannot obey raises RefusedError.

    Parameters
    ----------
    frame : LocalFrame
        Local frame with its origin at home.
    firmware : Firmware
        Modes, rules, behaviour and sticks of the firmware.
    yaw_rad : float
        Compass heading at the start.
    wind, epoch_unix_s, estimate_errors
        See `sim_vehicle.execution.executor.MissionExecutor`.

    Attributes
    ----------
    parameters : RuntimeParameters
        Values that may be changed; call `apply_parameters` after a change.
    outcome, outcome_text
        Outcome of the run and its reason.
    """

    def __init__(
        self,
        spec: VehicleSpec,
        frame: LocalFrame,
        firmware: Firmware,
        *,
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
        epoch_unix_s: float = EPOCH_UNIX_S,
        estimate_errors: EstimateErrors | None = None,
    ) -> None:
        executor = MissionExecutor(
            spec,
            frame,
            wind=wind,
            yaw_rad=yaw_rad,
            takes_off=firmware.takes_off,
            epoch_unix_s=epoch_unix_s,
            estimate_errors=estimate_errors,
        )
        super().__init__(executor, firmware)
        self.outcome = Outcome.RUNNING
        self.outcome_text = ""
        self.failsafe = Failsafe(self)
        self.mission = MissionStatus(self, self.failsafe)
        self.arming = ArmingChecks(self, self.failsafe)
        self._return_mode_s = math.inf
        self._rally: list[MissionItem] = []
        # Parts of the pilot that add-ons provide; the owner of the pilot appends them.
        self.extras: list[PilotExtra] = []
        self.modes = ModeControl(self, self.mission, self.extras)
        self._idle = None
        if self.rules.idle is not None:
            self._idle = IdleWatch(self, self.rules.idle, lambda: self.throttle_down)

    @property
    def sticks(self) -> Sticks | None:
        """Stick positions of the ground station, or None while no stick messages arrive."""
        return next((extra.sticks for extra in self.extras if extra.sticks is not None), None)

    @property
    def throttle_down(self) -> bool:
        """Whether no stick demands thrust."""
        return all(extra.throttle_down for extra in self.extras)

    # Plans and parameters

    def load(
        self, items: Sequence[MissionItem], *, marked: int | None = None, whole: bool = True
    ) -> MissionChange:
        """Replace the mission; a mission that cannot be flown is stored, but not flown.

        `marked` is the item at which to continue, by default (in flight) the item with the present number.
        `whole` is False for a part of an upload that overwrites the mission in place; a part is not checked.
        """
        mission, behaviour = self.mission, self.behaviour
        # A falling vehicle only stores the mission, because a falling autopilot does not notice the fall.
        flying = self.mode is Mode.MISSION and self.armed and not self.state.phase.is_lost
        airborne = self.armed and self.landed is not LandedState.ON_GROUND
        seq = marked or 0
        if marked is None and airborne:
            seq = mission.current_seq
            if seq >= len(items) and (behaviour.clamps_item or not flying):
                seq = max(len(items) - 1, 0) if behaviour.clamps_item else 0
        if whole:
            mission.check(items, in_air=airborne)
        ended = behaviour.stays_after_last and mission.complete and flying and airborne
        change = MissionChange.STORED
        if flying and items and not mission.problems and not ended:
            change = self._change(items, seq)
        else:
            self.executor.mission.load(items, current=seq, keeps_settings=airborne)
            self.refresh()
        if mission.returns and not flying:
            mission.choose()
        mission.complete = ended
        mission.started &= airborne
        if whole:
            self._report_problems(items)
        if flying and (not items or mission.problems):
            self.turn_to(Mode.HOLD)
            if not items:
                self.note(Severity.CRITICAL, behaviour.no_mission_text)
        return change

    def _change(self, items: Sequence[MissionItem], seq: int) -> MissionChange:
        """Continue the flight with another mission."""
        behaviour, executor = self.behaviour, self.executor
        is_beyond = seq >= len(items)
        turned = executor.mission.change(
            items, seq, at_waypoints=behaviour.restarts_leg, keeps_jumps=behaviour.keeps_jumps
        )
        self.mission.started = True
        self.refresh()
        if turned:
            return MissionChange.TURNED
        return MissionChange.LOST if is_beyond else MissionChange.LATER

    def _report_problems(self, items: Sequence[MissionItem]) -> None:
        """Report the problems of a mission."""
        mission = self.mission
        if self.spec.drives and any(item.command == Command.NAV_TAKEOFF for item in items):
            self.note(Severity.INFO, "Take-off items have no effect on a rover")
        if mission.problems:
            self._end(Outcome.MISSION_REJECTED, str(mission.problems[0]))
            self._report_rejection(mission.problems[0])
        elif self.outcome in (Outcome.MISSION_REJECTED, Outcome.COMPLETED, Outcome.FLIGHT_ABORTED):
            self._end(Outcome.RUNNING, "")

    def reject_mission(self, reason: str) -> None:
        """Record that the upload of a mission was refused; the old mission stays in force."""
        if not self.armed:
            self._end(Outcome.MISSION_REJECTED, reason)

    def set_fence(self, items: Sequence[MissionItem]) -> None:
        """Replace the fence and check the mission again, unless the vehicle is flying the mission."""
        self.failsafe.set_fence(Fence.of(items, self.frame, any_inclusion=self.rules.any_inclusion))
        self._check_mission_again()

    def set_rally(self, items: Sequence[MissionItem]) -> None:
        """Replace the rally points; a return leads to home or to a rally point that is nearer."""
        self._rally = [item for item in items if item.command == Command.NAV_RALLY_POINT]
        self._place_rally()

    def _place_rally(self) -> None:
        positions = item_positions(self._rally, self.frame, self.home_m[2])
        self.executor.mission.return_points.rally_m = tuple(
            position for position in positions if not math.isnan(position[0])
        )

    def set_home(self, latitude_deg: float, longitude_deg: float, up_m: float) -> None:
        """Move home to a position and a height above the start."""
        x_m, y_m = self.frame.from_wgs84(latitude_deg, longitude_deg)
        if not math.hypot(x_m, y_m) <= self.spec.max_distance_m:
            raise RefusedError(
                f"Home refused: more than {self.spec.max_distance_m:.0f} m from the start", denied=True
            )
        if not abs(up_m) <= self.spec.max_altitude_m:
            raise RefusedError(f"Home refused: {up_m:.0f} m above the start is out of range", denied=True)
        self.executor.mission.move_home((x_m, y_m, up_m))
        self._place_rally()
        self.failsafe.apply_parameters()

    def apply_parameters(self) -> None:
        """Apply the values of `parameters`."""
        parameters = self.parameters
        spec = parameters.applied_to(self.spec)
        self.executor.update_spec(with_autopilot(spec, spec.autopilot, parameters.settings))
        self.failsafe.apply_parameters()
        self._check_mission_again()

    def _check_mission_again(self) -> None:
        if self.armed and self.mode is Mode.MISSION:
            return
        problem = self.mission.check_again()
        if problem is not None:
            self._report_rejection(problem)

    def _report_rejection(self, problem: ItemProblem) -> None:
        if problem.code == "fence" and problem.item is not None:
            self.note(Severity.CRITICAL, self.behaviour.outside_text.format(problem.item + 1))
        self.note(Severity.CRITICAL, self.behaviour.rejected_text.format(problem))

    # Orders

    def arm(self, *, force: bool = False, text: str = "") -> None:
        """Start the motors; in the mission and take-off modes, the flight begins.

        `force` skips the pre-arm checks. `text` is the notice to the operator; by default, this is the notice
        of an arm command. If no mission has begun, a refusal is also the outcome of the run.
        """
        if self.armed:
            return
        problem = self.mission.why_not
        if problem is not None and not self.mission.items:
            problem = self.behaviour.empty_mission_text or problem
        reason = None if force else self.arming.why_not(self.mode, problem) or self.modes.why_not_arm()
        if reason is None:
            try:
                self.executor.arm()
            except VehicleError as error:
                reason = str(error)
        if reason is not None:
            if not self.mission.started:
                self._end(Outcome.ARMING_REFUSED, reason)
            for refusal in self.rules.arming_texts:
                self.note(Severity.CRITICAL, refusal.format(reason))
            raise RefusedError(self.rules.arming_texts[0].format(reason))
        self.failsafe.on_armed()
        if self._idle is not None:
            self._idle.on_armed()
        for extra in self.extras:
            extra.on_armed()
        self._end(Outcome.RUNNING, "")
        self.note(Severity.INFO, text or self.rules.armed)
        self.note(Severity.INFO, self.firmware.mavlink.modes.armed_texts.get(self.arming.custom_mode(), ""))
        if self.mode is Mode.MISSION and self.mission.why_not is not None:
            self.modes.override(Mode.HOLD)
        elif self.mode in (Mode.MISSION, Mode.TAKEOFF):
            self.turn_to(self.mode)

    def disarm(self, *, force: bool = False) -> None:
        """Stop the motors; in the air, this needs `force`."""
        if not self.armed:
            return
        try:
            self.executor.disarm(force=force)
        except VehicleError:
            raise RefusedError("Disarming denied: not landed", text=self.rules.disarming_text) from None
        self.refresh()
        self._on_disarmed((self.rules.disarmed,))

    def set_mode(self, mode: Mode) -> None:
        """Change the mode; an armed vehicle flies in the new mode at once."""
        text = self.behaviour.empty_mission_text
        if text and mode is Mode.MISSION and not self.armed:
            if not self.mission.items:
                self.note(Severity.CRITICAL, f"{self.rules.preflight}: {text}")
        else:
            self.modes.check(mode)
        if self.behaviour.stays_after_last and mode is self.mode is Mode.MISSION and self.mission.waits:
            return
        self._change_mode(mode)

    def takeoff(self, altitude_m: float) -> None:
        """Climb to an altitude above the start; a disarmed vehicle climbs when it arms."""
        if self.spec.drives:
            raise RefusedError("Takeoff refused: a rover stays on the ground", denied=True)
        if not 0.0 < altitude_m <= self.spec.max_altitude_m:
            raise RefusedError(f"Takeoff refused: altitude {altitude_m:g} m is out of range", denied=True)
        self.modes.takeoff_altitude_m = altitude_m
        self.set_mode(Mode.TAKEOFF)

    def goto(
        self,
        latitude_deg: float,
        longitude_deg: float,
        altitude_m: float,
        *,
        mode: Mode,
        heading: Heading = ALONG,
        speed_m_s: float | None = None,
    ) -> None:
        """Fly to a position at an altitude above the start and hold there."""
        self._check_flying()
        x_m, y_m = self.frame.from_wgs84(latitude_deg, longitude_deg)
        distance_m = math.hypot(x_m, y_m)
        if not (distance_m <= self.spec.max_distance_m and self.spec.reaches(altitude_m)):
            raise RefusedError(
                f"Reposition out of range: {distance_m:.0f} m away, {altitude_m:.0f} m high", denied=True
            )
        outside = self.failsafe.outside((x_m, y_m, altitude_m))
        if outside is not None:
            raise RefusedError(
                f"Reposition refused by the fence: {outside}", denied=True, text=self.rules.fence_refusal
            )
        guided = mode is Mode.GUIDED
        for extra in self.extras:
            extra.free_heading()
            extra.stop()
        if guided:
            self.modes.check(Mode.HOLD)
            self.modes.override(mode)
        else:
            self.hold_in(mode)
        if speed_m_s is None and self.behaviour.replays_speed:
            # The mission gets its speed back when it resumes.
            speed_m_s = self.spec.cruise_speed_m_s
        self.order(
            lambda: self.executor.goto(
                x_m, y_m, altitude_m, heading=heading, speed_m_s=speed_m_s, as_setpoint=guided
            )
        )

    def look_at(self, latitude_deg: float | None, longitude_deg: float = 0.0) -> None:
        """Point the nose at a position, however the vehicle flies; None ends this."""
        position = None if latitude_deg is None else self.frame.from_wgs84(latitude_deg, longitude_deg)
        for extra in self.extras:
            extra.free_heading()
        self.executor.flight.look_at(position)

    def pause(self) -> None:
        """Stop and hold, in the hold mode (PX4) or without a mode change (ArduPilot)."""
        if not self.rules.pauses_in_mode:
            self.set_mode(Mode.HOLD)
            return
        if not self.armed or self.mode not in (Mode.MISSION, Mode.GUIDED):
            raise RefusedError("Pause refused: not flying in mission or guided mode")
        for extra in self.extras:
            extra.forget()
            extra.stop()
        self.order(self.executor.flight.hold)

    def resume(self) -> None:
        """Resume the mission after a pause; in ArduPilot's guided mode, setpoints end the pause instead."""
        if self.rules.pauses_in_mode and self.mode is Mode.GUIDED:
            return
        if self.rules.pauses_in_mode and self.mode is not Mode.MISSION:
            raise RefusedError(f"Resume refused: not possible in mode {self.mode.value}")
        self.start_mission()

    def start_mission(self, first: int | None = None) -> None:
        """Begin or resume the mission at an item; a completed mission restarts.

        By PX4's rules, this also arms a disarmed vehicle.
        """
        self.modes.check(Mode.MISSION)
        if first is not None:
            self.set_current(first)
        self._change_mode(Mode.MISSION)
        if self.rules.armed_by_start and not self.armed:
            self.arm(text=self.rules.armed_by_start)

    def set_current(self, seq: int) -> None:
        """Continue at this mission item; raises RefusedError if the item does not exist."""
        size = self.mission.size
        if not 0 <= seq < size:
            raise RefusedError(f"Mission item {seq + 1} refused: the mission has {size} items", denied=True)
        self.mission.choose()
        self.order(lambda: self.executor.mission.set_current(seq))

    def go_around(self, height_m: float | None = None) -> None:
        """Abort the landing of the mission, climb, and restart the landing."""

        def climb() -> None:
            top_m = self.executor.mission.go_around(height_m)
            self.note(Severity.NOTICE, f"Landing aborted, climbing to {top_m:.0f}m")

        self.order(climb)

    def set_speed(self, speed_m_s: float) -> None:
        """Change the ground speed; raises RefusedError above the vehicle's limit."""
        if not 0.0 < speed_m_s <= self.spec.top_speed_m_s:
            raise RefusedError(
                f"Speed refused: {speed_m_s:g} m/s is outside 0..{self.spec.top_speed_m_s:g}", denied=True
            )
        self.order(lambda: self.executor.set_speed(speed_m_s))

    # Failures

    def fail_motor(self, failed: bool = True) -> None:
        """Fail or repair a motor; a vehicle with a failed motor falls and cannot arm."""
        self.motor_ok = not failed
        if failed and self.armed:
            self.terminate("motor failure")

    def drain_battery(self, fraction: float) -> None:
        """Reduce the battery's charge to at most this fraction of its capacity."""
        self.executor.flight.drain_battery(fraction)
        self.refresh()

    def change_battery(self) -> None:
        """Install a full battery; do nothing while the motors run."""
        self.executor.flight.change_battery()
        self.refresh()

    def terminate(self, reason: str) -> None:
        """Stop all thrust at once, so that the vehicle falls."""
        self.note(Severity.CRITICAL, f"Flight terminated: {reason}")
        self.failsafe.give_up()
        if self.landed is not LandedState.ON_GROUND:
            self._end(Outcome.CRASHED, reason)
        self.executor.flight.fall()
        self.refresh()

    # Time and flight events

    def advance(self, now_s: float) -> list[FlightEvent]:
        """Fly until a time, and return the events in order."""
        self.now_s = now_s
        events = self.executor.advance(now_s)
        self.refresh()
        for event in events:
            self._on_event(event)
        if self.behaviour.return_lag_s is not None:
            self._end_in_return(self.behaviour.return_lag_s)
        if self.armed:
            for reaction in self.failsafe.check():
                self._carry_out(reaction)
            for extra in self.extras:
                for reaction in extra.check():
                    self.failsafe.active = True
                    self._carry_out(reaction)
            if self._idle is not None and self.armed and self._idle.is_over():
                self.executor.disarm()
                self.refresh()
                self._on_disarmed(self._idle.texts)
            for extra in self.extras:
                extra.fly_on()
        else:
            for extra in self.extras:
                extra.stop()
        return events

    def _end_in_return(self, lag_s: float) -> None:
        """Enter the return mode if the vehicle flies a final return item; the vehicle keeps its path."""
        executor, mission, now_s = self.executor, self.mission, self.executor.time_s
        if not (self.armed and self.mode is Mode.MISSION and self.landed is not LandedState.ON_GROUND):
            self._return_mode_s = math.inf
        elif not mission.returns:
            self._return_mode_s = math.inf
            if not executor.mission.returns:
                return
            mission.returns, self._return_mode_s = True, now_s + lag_s
            self.note(Severity.INFO, self.behaviour.finished_texts[0])
            self.note(Severity.INFO, self.behaviour.return_text)
        elif now_s >= self._return_mode_s:
            self._return_mode_s, intended = math.inf, self.modes.intended
            executor.mission.leave_to_return()
            self.refresh()
            self.modes.override(Mode.RTL)
            self.modes.by_itself, self.modes.intended = True, intended

    def _on_event(self, event: FlightEvent) -> None:
        if isinstance(event, TargetReached):
            self.modes.on_target_reached()
        elif isinstance(event, LandingRestarted):
            starts = self.mission.items[event.seq].command == Command.DO_LAND_START
            how = "via DO_LAND_START:" if starts else "sequence at waypoint"
            # ArduPilot counts home as item 0, so the notice adds 1.
            self.note(Severity.NOTICE, f"Restarted landing {how} {event.seq + 1}")
        elif isinstance(event, MissionComplete):
            self.mission.complete = True
            if not self.mission.returns:
                self.note(Severity.INFO, self.behaviour.finished_texts[self.landed is LandedState.ON_GROUND])
            if self.armed and self.landed is LandedState.IN_AIR and not self.behaviour.stays_after_last:
                self.turn_to(Mode.HOLD)
                self.modes.intended = Mode.HOLD
        elif isinstance(event, CannotFly):
            # The vehicle returns home; if it returns already, it lands.
            where = f"Item {event.seq + 1}: " if event.seq >= 0 else ""
            self.note(Severity.CRITICAL, f"{where}{event.reason}")
            if not self.outcome.is_over:
                self._end(Outcome.CANNOT_FLY_ITEM, f"{where}{event.reason}")
            if self.armed and self.landed is not LandedState.ON_GROUND and self.mode is not Mode.LAND:
                self.turn_to(Mode.LAND if self.mode is Mode.RTL else Mode.RTL)
        elif isinstance(event, BatteryDepleted):
            self.failsafe.give_up()
            self._end(Outcome.BATTERY_DEPLETED, f"battery empty at {event.time_s:.0f} s")
            self.note(Severity.CRITICAL, "Battery empty: coming down")
        elif isinstance(event, Landed):
            self.mission.complete |= self.mission.returns and self.mode is Mode.RTL
            idle = self.rules.idle
            if idle is not None and not idle.first_flight and self.mode not in _LANDS:
                self.executor.stay_armed()
        elif isinstance(event, Disarmed):
            self._on_disarmed(self.rules.landed)

    def _on_disarmed(self, texts: tuple[str, ...]) -> None:
        for text in texts:
            self.note(Severity.INFO, text)
        mission = self.mission
        if mission.started and not self.outcome.is_over:
            if mission.waits:
                self._end(Outcome.COMPLETED, "mission complete")
            else:
                where = f"disarmed at item {min(mission.current_seq + 1, mission.size)} of {mission.size}"
                self._end(Outcome.FLIGHT_ABORTED, where)
        mission.started = False
        mission.check_on_ground()
        if self.rules.restores_mode:
            self.modes.override(self.modes.intended)

    def _carry_out(self, reaction: Reaction) -> None:
        """Carry out the reaction that a failsafe demands."""
        self._end(reaction.outcome, reaction.reason)
        point_m = reaction.return_point_m
        if point_m is not None:
            intended = self.modes.intended
            self.modes.override(Mode.HOLD)
            self.modes.intended = intended
            self.order(lambda: self.executor.return_home(point_m))
        elif reaction.action is Action.TERMINATE:
            self.terminate(reaction.reason)
        elif reaction.action is Action.DISARM:
            self.disarm(force=True)
        else:
            self.turn_to(_MODES[reaction.action])

    def _check_flying(self) -> None:
        if not self.armed or self.landed is LandedState.ON_GROUND:
            raise RefusedError("Reposition refused: not flying")

    def hold_in(self, mode: Mode) -> None:
        """Hold the position in `mode`, which is the autopilot's mode for single orders."""
        self._check_flying()
        self.set_mode(Mode.HOLD)
        self.modes.override(mode)

    def turn_to(self, mode: Mode) -> None:
        """Change the mode by a decision of the vehicle itself; a refusal becomes a warning."""
        intended = self.modes.intended
        try:
            self._change_mode(mode)
        except RefusedError as refusal:
            self.note(Severity.WARNING, str(refusal))
        else:
            self.modes.by_itself, self.modes.intended = True, intended

    def _change_mode(self, mode: Mode) -> None:
        if self.modes.change(mode):
            self.disarm()

    def _end(self, outcome: Outcome, reason: str) -> None:
        """Record the outcome of the run."""
        self.outcome = outcome
        self.outcome_text = reason
