"""The autopilot without MAVLink: modes, arming, failsafes and the outcome, on top of the mission executor."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geo.frame import LocalFrame
from mission.model import Command, MissionItem
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot.failsafe_rules import FailsafeRules
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.state import (
    BatteryDepleted,
    CannotFly,
    Disarmed,
    FlightEvent,
    LandedState,
    MissionComplete,
    Phase,
    TargetReached,
)
from sim_vehicle.motion.legs import ALONG, Heading
from sim_vehicle.pilot.arming import why_not_arm
from sim_vehicle.pilot.failsafe import Failsafe
from sim_vehicle.pilot.keeper import Keeper
from sim_vehicle.pilot.modes import Outcome
from sim_vehicle.pilot.notices import MissionState, Notice, RefusedError, Severity
from sim_vehicle.pilot.setpoints import Steering
from sim_vehicle.weather.wind import Wind

__all__ = ["MissionState", "Notice", "Pilot", "RefusedError", "Severity"]


class Pilot(Keeper):
    """One vehicle under orders.

    Parameters
    ----------
    spec : VehicleSpec
    frame : LocalFrame
        About home.
    wind : Wind, optional
    yaw_rad : float
        Compass heading at the start.
    mode : Mode
        At the start.
    takes_off : bool
        Whether a mission needs no take-off item.
    after_takeoff : Mode
        The mode that follows an ordered take-off.
    rules : FailsafeRules
        What the autopilot does when something goes wrong.
    epoch_unix_s : float, optional
        Time of day at time 0.

    Attributes
    ----------
    mode : Mode
    now_s : float
        Time of the last `advance`.
    executor : MissionExecutor
        What flies.
    failsafe : Failsafe
        The safety functions.
    steering : Steering
        Setpoints.
    state : VehicleState
        At the time of the last `advance`.
    outcome, outcome_text
        How the run ended and why.
    position_ok : bool
        Whether there is a position (GPS); assign it.
    motor_ok : bool
        Whether all motors run; see `fail_motor`.
    arming_block : str or None
        A reason from outside not to arm.
    """

    def __init__(
        self,
        spec: VehicleSpec,
        frame: LocalFrame,
        *,
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
        mode: Mode = Mode.HOLD,
        takes_off: bool = False,
        after_takeoff: Mode = Mode.HOLD,
        rules: FailsafeRules,
        epoch_unix_s: float | None = None,
    ) -> None:
        super().__init__(
            spec,
            frame,
            wind=wind,
            yaw_rad=yaw_rad,
            mode=mode,
            takes_off=takes_off,
            rules=rules,
            epoch_unix_s=epoch_unix_s,
        )
        self.failsafe = Failsafe(self, rules)
        self.steering = Steering(self)
        self._after_takeoff = after_takeoff
        self._takeoff_altitude_m: float | None = None

    def load(self, items: Sequence[MissionItem]) -> None:
        """Replace the mission; one that cannot be flown is kept, but not flown.

        In flight, ArduPilot goes on with the item of the same number, PX4 begins anew.
        """
        self._judge(items)
        flying = self.mode is Mode.MISSION and self.armed
        airborne = self.armed and self.landed is not LandedState.ON_GROUND
        keeps = self.failsafe.rules.keeps_item and airborne and 0 < self.current_seq < len(items)
        self.executor.load(items, current=self.current_seq if keeps else 0)
        self._started = self._complete = False
        if self.spec.kind == "rover" and any(item.command == Command.NAV_TAKEOFF for item in items):
            self.note(Severity.INFO, "Take-off items have no effect on a rover")
        if self._problems:
            self.end(Outcome.MISSION_REJECTED, self._problems[0])
            self.note(Severity.CRITICAL, f"Mission rejected: {self._problems[0]}")
        elif self.outcome in (Outcome.MISSION_REJECTED, Outcome.COMPLETED, Outcome.INTERRUPTED):
            self.end(Outcome.RUNNING, "")
        if flying:
            self.turn_to(Mode.MISSION if items and not self._problems else Mode.HOLD)

    def arm(self, *, force: bool = False) -> None:
        """Start the motors; in mission or take-off mode the flight begins.

        Raises
        ------
        RefusedError
            With the reason, which is also the outcome of a vehicle that has not flown.
        """
        if self.armed:
            return
        reason = None if force else why_not_arm(self)
        if reason is None:
            try:
                self.executor.arm()
            except VehicleError as error:
                reason = str(error)
        if reason is not None:
            if not self._started:
                self.end(Outcome.ARMING_REFUSED, reason)
            rules = self.failsafe.rules
            self.note(Severity.CRITICAL, f"{rules.preflight}: {reason}")
            raise RefusedError(f"{rules.arming}: {reason}")
        self.failsafe.armed()
        self.end(Outcome.RUNNING, "")
        self.note(Severity.INFO, "Armed")
        if self.mode is Mode.MISSION and self.why_no_mission() is not None:
            self.mode = Mode.HOLD
        elif self.mode in (Mode.MISSION, Mode.TAKEOFF):
            self.turn_to(self.mode)

    def disarm(self, *, force: bool = False) -> None:
        """Stop the motors; in the air only by force.

        Raises
        ------
        RefusedError
            In the air without force.
        """
        if not self.armed:
            return
        try:
            self.executor.disarm(force=force)
        except VehicleError:
            msg = "Disarming denied: not landed"
            raise RefusedError(msg) from None
        self.state = self.executor.state()
        self._disarmed()

    def set_mode(self, mode: Mode) -> None:
        """Change the mode; armed, the vehicle does it at once.

        Raises
        ------
        RefusedError
            When the mode is not possible now.
        """
        if mode is Mode.MISSION:
            reason = self.why_no_mission()
            if reason is not None:
                raise RefusedError(f"Mission mode refused: {reason}")
        if mode is not Mode.MANUAL and not self.position_ok:
            raise RefusedError(f"Mode {mode.value} refused: no position")
        if self.state.phase.is_lost:
            why = "battery empty" if self.state.phase is Phase.DEPLETED else "falling"
            raise RefusedError(f"Mode {mode.value} refused: {why}")
        if mode is Mode.GUIDED and self.failsafe.rules.needs_stream and not self.steering.is_fresh:
            msg = "Mode guided refused: no setpoints"
            raise RefusedError(msg)
        self._order(mode)

    def takeoff(self, altitude_m: float) -> None:
        """Climb to an altitude above home; disarmed, as soon as it is armed."""
        if self.spec.kind == "rover":
            raise RefusedError("Takeoff refused: a rover stays on the ground", denied=True)
        if not 0.0 < altitude_m <= self.spec.max_altitude_m:
            raise RefusedError(f"Takeoff refused: altitude {altitude_m:g} m", denied=True)
        self._takeoff_altitude_m = altitude_m
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
        """Fly to a place at an altitude above home and stay there."""
        if not self.armed or self.landed is LandedState.ON_GROUND:
            msg = "Reposition refused: not flying"
            raise RefusedError(msg)
        x_m, y_m = self.frame.from_wgs84(latitude_deg, longitude_deg)
        distance_m = math.hypot(x_m, y_m)
        high = 0.0 < altitude_m <= self.spec.max_altitude_m or self.spec.kind == "rover"
        if not distance_m <= self.spec.max_distance_m or not high:
            msg = f"Reposition refused: {distance_m:.0f} m from home, {altitude_m:.0f} m high"
            raise RefusedError(msg, denied=True)
        outside = self.failsafe.outside((x_m, y_m, altitude_m))
        if outside is not None:
            raise RefusedError(f"Reposition refused by the fence: {outside}", denied=True)
        self._take_over(mode)
        self._command(lambda: self.executor.goto(x_m, y_m, altitude_m, heading=heading, speed_m_s=speed_m_s))

    def orbit(
        self,
        latitude_deg: float,
        longitude_deg: float,
        altitude_m: float,
        *,
        radius_m: float,
        speed_m_s: float,
        mode: Mode,
    ) -> None:
        """Fly circles about a place at an altitude above home."""
        x_m, y_m = self.frame.from_wgs84(latitude_deg, longitude_deg)
        self._take_over(mode)
        self._command(lambda: self.executor.orbit(x_m, y_m, altitude_m, radius_m, speed_m_s))

    def turn(self, yaw_rad: float) -> None:
        """Turn on the place; RefusedError while something else is flown."""
        if self.state.phase is not Phase.HOLD:
            msg = "Yaw refused: the vehicle is not holding"
            raise RefusedError(msg)
        x_m, y_m, z_m = self.executor.motion.stopping_point()
        self._command(lambda: self.executor.goto(x_m, y_m, z_m, heading=Heading.fixed(yaw_rad)))

    def _take_over(self, mode: Mode) -> None:
        """Hold, in the mode that a single order is flown in."""
        if not self.armed or self.landed is LandedState.ON_GROUND:
            msg = "Reposition refused: not flying"
            raise RefusedError(msg)
        self.set_mode(Mode.HOLD)
        self.mode = mode
        self.steering.forget()

    def pause(self) -> None:
        """Stop and stay: in the hold mode (PX4), or without leaving the mode (ArduPilot)."""
        if not self.failsafe.rules.pauses_in_mode:
            self.set_mode(Mode.HOLD)
            return
        if not self.armed or self.mode not in (Mode.MISSION, Mode.GUIDED):
            raise RefusedError(f"Pause refused: mode {self.mode.value}")
        self.steering.forget()
        self._command(self.executor.hold)

    def resume(self) -> None:
        """Go on after a pause: with the mission, or (ArduPilot in guided mode) with the next setpoint."""
        if self.failsafe.rules.pauses_in_mode and self.mode is Mode.GUIDED:
            return
        if self.failsafe.rules.pauses_in_mode and self.mode is not Mode.MISSION:
            raise RefusedError(f"Resume refused: mode {self.mode.value}")
        self.set_mode(Mode.MISSION)

    def fail_motor(self, failed: bool = True) -> None:
        """Stop a motor for good, or repair it: without it a vehicle in the air falls, and cannot arm."""
        self.motor_ok = not failed
        if failed and self.armed:
            self.terminate("motor failure")

    def terminate(self, reason: str) -> None:
        """Lose the thrust at once: the vehicle falls."""
        self.note(Severity.CRITICAL, f"Flight terminated: {reason}")
        self.failsafe.gave_out()
        if self.landed is not LandedState.ON_GROUND:
            self.end(Outcome.CRASHED, reason)
        self.executor.fall()
        self.state = self.executor.state()

    def return_to(self, place_m: tuple[float, float, float]) -> None:
        """Fly to a place (east, north, least height) by the vehicle's own decision and hold there."""
        self.mode = Mode.HOLD
        self.steering.forget()
        self._command(lambda: self.executor.return_home(place_m))

    def set_current(self, seq: int) -> None:
        """Go on with this mission item; Refused when there is none."""
        if not 0 <= seq < self.mission_size:
            raise RefusedError(f"Mission item {seq} refused: there are {self.mission_size}", denied=True)
        self._complete = False
        self._command(lambda: self.executor.set_current(seq))

    def set_speed(self, speed_m_s: float) -> None:
        """Change the ground speed; Refused beyond the vehicle's limit."""
        if not 0.0 < speed_m_s <= self.spec.top_speed_m_s:
            raise RefusedError(
                f"Speed refused: {speed_m_s:g} of {self.spec.top_speed_m_s:g} m/s", denied=True
            )
        self._command(lambda: self.executor.set_speed(speed_m_s))

    def advance(self, now_s: float) -> list[FlightEvent]:
        """Fly up to a time and return what happened."""
        self.now_s = now_s
        events = self.executor.advance(now_s)
        self.state = self.executor.state()
        for event in events:
            self._react(event)
        if self.executor.armed:
            self.failsafe.check()
            self.steering.check()
        return events

    def _react(self, event: FlightEvent) -> None:
        if isinstance(event, TargetReached):
            if self.mode is Mode.TAKEOFF:
                self.mode = self._after_takeoff
        elif isinstance(event, MissionComplete):
            self._complete = True
            self.note(Severity.INFO, "Mission complete")
            if self.armed and self.landed is LandedState.IN_AIR:
                self.turn_to(Mode.HOLD)
        elif isinstance(event, CannotFly):
            self._give_up(event)
        elif isinstance(event, BatteryDepleted):
            self.failsafe.gave_out()
            self.end(Outcome.BATTERY_DEPLETED, f"battery empty at {event.time_s:.0f} s")
            self.note(Severity.CRITICAL, "Battery empty: coming down")
        elif isinstance(event, Disarmed):
            self._disarmed()

    def _give_up(self, event: CannotFly) -> None:
        """Bring the vehicle down after something that it could not do: home first, else here."""
        where = f"Item {event.seq}: " if event.seq >= 0 else ""
        self.note(Severity.CRITICAL, f"{where}{event.reason}")
        if not self.outcome.is_over:
            self.end(Outcome.CANNOT_FLY_ITEM, f"{where}{event.reason}")
        if self.armed and self.landed is not LandedState.ON_GROUND and self.mode is not Mode.LAND:
            self.turn_to(Mode.LAND if self.mode is Mode.RTL else Mode.RTL)

    def _disarmed(self) -> None:
        self.note(Severity.INFO, "Disarmed")
        if self._started and not self.outcome.is_over:
            if self._complete:
                self.end(Outcome.COMPLETED, "mission complete")
            else:
                self.end(Outcome.INTERRUPTED, f"disarmed at item {self.current_seq} of {self.mission_size}")
        self._started = False

    def turn_to(self, mode: Mode) -> None:
        """Take a mode by the vehicle's own decision; what is not possible is told."""
        try:
            self._order(mode)
        except RefusedError as refusal:
            self.note(Severity.WARNING, str(refusal))

    def _order(self, mode: Mode) -> None:
        """Take the mode and, armed, do what it means; what is refused leaves the mode as it was."""
        self.steering.forget()
        before, self.mode = self.mode, mode
        if not self.armed:
            return
        try:
            self._do(mode)
        except RefusedError:
            self.mode = before
            raise

    def _do(self, mode: Mode) -> None:
        on_ground = self.landed is LandedState.ON_GROUND
        if mode is Mode.MISSION:
            self._fly_mission()
        elif mode is Mode.TAKEOFF:
            altitude_m = self._takeoff_altitude_m or self.spec.takeoff_altitude_m
            self._takeoff_altitude_m = None
            self._command(lambda: self.executor.takeoff(altitude_m))
        elif mode in (Mode.RTL, Mode.LAND):
            if on_ground:
                self.disarm()
            else:
                self._command(self.executor.return_home if mode is Mode.RTL else self.executor.land)
        elif not on_ground or self.state.phase is not Phase.GROUND:
            self._command(self.executor.hold)
        if mode is Mode.GUIDED:
            self._command(self.steering.begin)

    def _fly_mission(self) -> None:
        if self._complete:
            self.executor.set_current(0)
        self._complete = False
        self._started = True
        self._command(self.executor.start)
