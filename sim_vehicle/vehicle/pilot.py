"""The autopilot without MAVLink: modes, arming, failsafes and the outcome, on top of the mission executor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

from geo.frame import LocalFrame
from mission.model import MissionItem
from sim_vehicle.errors import VehicleError
from sim_vehicle.executor import MissionExecutor, check_mission
from sim_vehicle.flight import (
    BatteryDepleted,
    CannotFly,
    Disarmed,
    FlightEvent,
    LandedState,
    MissionComplete,
    Phase,
    TargetReached,
    VehicleState,
)
from sim_vehicle.spec import VehicleSpec
from sim_vehicle.vehicle.arming import why_not_arm
from sim_vehicle.vehicle.modes import Mode, Outcome
from sim_vehicle.vehicle.parameters import Tuning
from sim_vehicle.wind import Wind

__all__ = ["MissionState", "Notice", "Pilot", "RefusedError", "Severity"]


class Severity(IntEnum):
    """As MAV_SEVERITY numbers them."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


class MissionState(IntEnum):
    """As MISSION_STATE numbers them."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that the operator is told."""

    severity: Severity
    text: str


class RefusedError(VehicleError):
    """An order that the vehicle does not take.

    Parameters
    ----------
    reason : str
        For the operator.
    denied : bool
        The order can never be taken as it is; False when it may be taken later.
    """

    def __init__(self, reason: str, *, denied: bool = False) -> None:
        super().__init__(reason)
        self.denied = denied


class Pilot:
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

    Attributes
    ----------
    mode : Mode
    state : VehicleState
        At the time of the last `advance`.
    outcome, outcome_text
        How the run ended and why.
    position_ok : bool
        Whether there is a position (GPS).
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
    ) -> None:
        self.spec = spec
        self.frame = frame
        self.tuning = Tuning.of(spec)
        self.mode = mode
        self.outcome = Outcome.RUNNING
        self.outcome_text = ""
        self.position_ok = True
        self.arming_block: str | None = None
        self._executor = MissionExecutor(spec, frame, wind=wind, yaw_rad=yaw_rad)
        self._executor.takes_off = takes_off
        self._after_takeoff = after_takeoff
        self.state: VehicleState = self._executor.state()
        self._notices: list[Notice] = []
        self._problems: tuple[str, ...] = ()
        self._started = False
        self._complete = False
        self._failsafe = 0
        self._takeoff_altitude_m: float | None = None

    @property
    def armed(self) -> bool:
        """Whether the motors run."""
        return self._executor.armed

    @property
    def landed(self) -> LandedState:
        """Ground contact."""
        return self.state.landed

    @property
    def failsafe(self) -> bool:
        """Whether a failsafe has taken over."""
        return self._failsafe > 0

    @property
    def mission_size(self) -> int:
        """Items of the mission."""
        return len(self._executor.items)

    @property
    def current_seq(self) -> int:
        """The mission item that is flown now or next."""
        return max(0, self._executor.current_seq)

    @property
    def mission_state(self) -> MissionState:
        """Progress of the mission."""
        if not self._executor.items or self._problems:
            return MissionState.NO_MISSION
        if self._complete:
            return MissionState.COMPLETE
        if not self._started:
            return MissionState.NOT_STARTED
        flying = self.mode is Mode.MISSION and self.armed
        return MissionState.ACTIVE if flying else MissionState.PAUSED

    def notices(self) -> list[Notice]:
        """Return what was noted since the last call."""
        taken, self._notices = self._notices, []
        return taken

    def note(self, severity: Severity, text: str) -> None:
        """Tell the operator."""
        self._notices.append(Notice(severity, text))

    def why_no_mission(self) -> str | None:
        """Return why the mission cannot be flown, None when it can."""
        if not self._executor.items:
            return "no mission"
        return self._problems[0] if self._problems else None

    def load(self, items: Sequence[MissionItem]) -> None:
        """Replace the mission; one that cannot be flown is kept, but not flown."""
        self._problems = ()
        if items:
            needs_takeoff = not self._executor.takes_off
            problems = check_mission(items, self.frame, self.spec, needs_takeoff=needs_takeoff)
            self._problems = tuple(problems)
        flying = self.mode is Mode.MISSION and self.armed
        self._executor.load(items)
        self._started = self._complete = False
        if self._problems:
            self._end(Outcome.MISSION_REJECTED, self._problems[0])
            self.note(Severity.CRITICAL, f"Mission rejected: {self._problems[0]}")
        elif self.outcome in (Outcome.MISSION_REJECTED, Outcome.COMPLETED, Outcome.INTERRUPTED):
            self._end(Outcome.RUNNING, "")
        if flying:
            self._turn_to(Mode.MISSION if items and not self._problems else Mode.HOLD)

    def reject_mission(self, reason: str) -> None:
        """Note that a mission was refused in its transfer; the old one stays in force."""
        if not self.armed:
            self._end(Outcome.MISSION_REJECTED, reason)

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
                self._executor.arm()
            except VehicleError as error:
                reason = str(error)
        if reason is not None:
            if not self._started:
                self._end(Outcome.ARMING_REFUSED, reason)
            raise RefusedError(f"Arming denied: {reason}")
        self._failsafe = 0
        self._end(Outcome.RUNNING, "")
        self.note(Severity.INFO, "Armed")
        if self.mode is Mode.MISSION and self.why_no_mission() is not None:
            self.mode = Mode.HOLD
        elif self.mode in (Mode.MISSION, Mode.TAKEOFF):
            self._turn_to(self.mode)

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
            self._executor.disarm(force=force)
        except VehicleError:
            msg = "Disarming denied: not landed"
            raise RefusedError(msg) from None
        self.state = self._executor.state()
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
        if self.state.phase is Phase.DEPLETED:
            raise RefusedError(f"Mode {mode.value} refused: battery empty")
        self._order(mode)

    def takeoff(self, altitude_m: float) -> None:
        """Climb to an altitude above home; disarmed, as soon as it is armed."""
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
        yaw_rad: float | None = None,
        speed_m_s: float | None = None,
    ) -> None:
        """Fly to a place at an altitude above home and stay there."""
        if not self.armed or self.landed is LandedState.ON_GROUND:
            msg = "Reposition refused: not flying"
            raise RefusedError(msg)
        x_m, y_m = self.frame.from_wgs84(latitude_deg, longitude_deg)
        distance_m = math.hypot(x_m, y_m)
        if not distance_m <= self.spec.max_distance_m or not 0.0 < altitude_m <= self.spec.max_altitude_m:
            msg = f"Reposition refused: {distance_m:.0f} m from home, {altitude_m:.0f} m high"
            raise RefusedError(msg, denied=True)
        self.set_mode(Mode.HOLD)
        self.mode = mode
        self._command(lambda: self._executor.goto(x_m, y_m, altitude_m, yaw_rad=yaw_rad, speed_m_s=speed_m_s))

    def set_current(self, seq: int) -> None:
        """Go on with this mission item; Refused when there is none."""
        if not 0 <= seq < self.mission_size:
            raise RefusedError(f"Mission item {seq} refused: there are {self.mission_size}", denied=True)
        self._complete = False
        self._command(lambda: self._executor.set_current(seq))

    def set_speed(self, speed_m_s: float) -> None:
        """Change the ground speed; Refused beyond the vehicle's limit."""
        if not 0.0 < speed_m_s <= self.spec.top_speed_m_s:
            raise RefusedError(
                f"Speed refused: {speed_m_s:g} of {self.spec.top_speed_m_s:g} m/s", denied=True
            )
        self._command(lambda: self._executor.set_speed(speed_m_s))

    def retune(self) -> None:
        """Take the values of `tuning`."""
        tuning = self.tuning
        self.spec = replace(
            self.spec,
            cruise_speed_m_s=tuning.cruise_speed_m_s,
            acceptance_radius_m=tuning.acceptance_radius_m,
            takeoff_altitude_m=tuning.takeoff_altitude_m,
            return_altitude_m=tuning.return_altitude_m,
            landing_speed_m_s=tuning.landing_speed_m_s,
            disarm_delay_s=tuning.disarm_delay_s,
        )
        self._executor.respec(self.spec)

    def advance(self, now_s: float) -> list[FlightEvent]:
        """Fly up to a time and return what happened."""
        events = self._executor.advance(now_s)
        self.state = self._executor.state()
        for event in events:
            self._react(event)
        if self.armed:
            self._watch_battery()
        return events

    def _react(self, event: FlightEvent) -> None:
        if isinstance(event, TargetReached):
            if self.mode is Mode.TAKEOFF:
                self.mode = self._after_takeoff
        elif isinstance(event, MissionComplete):
            self._complete = True
            self.note(Severity.INFO, "Mission complete")
            if self.armed and self.landed is LandedState.IN_AIR:
                self._turn_to(Mode.HOLD)
        elif isinstance(event, CannotFly):
            self._give_up(event)
        elif isinstance(event, BatteryDepleted):
            self._failsafe = 3
            self._end(Outcome.BATTERY_DEPLETED, f"battery empty at {event.time_s:.0f} s")
            self.note(Severity.CRITICAL, "Battery empty: coming down")
        elif isinstance(event, Disarmed):
            self._disarmed()

    def _give_up(self, event: CannotFly) -> None:
        """Bring the vehicle down after something that it could not do: home first, else here."""
        where = f"Item {event.seq}: " if event.seq >= 0 else ""
        self.note(Severity.CRITICAL, f"{where}{event.reason}")
        if not self.outcome.is_over:
            self._end(Outcome.CANNOT_FLY_ITEM, f"{where}{event.reason}")
        if self.armed and self.landed is not LandedState.ON_GROUND and self.mode is not Mode.LAND:
            self._turn_to(Mode.LAND if self.mode is Mode.RTL else Mode.RTL)

    def _watch_battery(self) -> None:
        battery = self.state.battery
        if battery is None or self.state.phase is Phase.DEPLETED:
            return
        level = 2 if battery.fraction < self.tuning.critical_fraction else 0
        level = level or (1 if battery.fraction < self.tuning.low_fraction else 0)
        if level <= self._failsafe:
            return
        self._failsafe = level
        percent = f"{100.0 * battery.fraction:.0f} %"
        homing = self.state.phase in (Phase.RETURN, Phase.LAND)
        if level == 2:
            self.note(Severity.CRITICAL, f"Battery critical ({percent}): landing")
        else:
            self.note(Severity.WARNING, f"Battery low ({percent})" + ("" if homing else ": returning"))
        if self.tuning.low_battery_action == 0 or self.landed is LandedState.ON_GROUND:
            return
        if level == 2 and self.state.phase is not Phase.LAND:
            self._end(Outcome.BATTERY_LOW, f"battery critical ({percent})")
            self._turn_to(Mode.LAND)
        elif level == 1 and not homing:
            self._end(Outcome.BATTERY_LOW, f"battery low ({percent})")
            self._turn_to(Mode.RTL)

    def _disarmed(self) -> None:
        self.note(Severity.INFO, "Disarmed")
        if self._started and not self.outcome.is_over:
            if self._complete:
                self._end(Outcome.COMPLETED, "mission complete")
            else:
                self._end(Outcome.INTERRUPTED, f"disarmed at item {self.current_seq} of {self.mission_size}")
        self._started = False

    def _turn_to(self, mode: Mode) -> None:
        """Take a mode by the vehicle's own decision; what is not possible is told."""
        try:
            self._order(mode)
        except RefusedError as refusal:
            self.note(Severity.WARNING, str(refusal))

    def _order(self, mode: Mode) -> None:
        """Take the mode and, armed, do what it means; what is refused leaves the mode as it was."""
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
            altitude_m = self._takeoff_altitude_m or self.tuning.takeoff_altitude_m
            self._takeoff_altitude_m = None
            self._command(lambda: self._executor.takeoff(altitude_m))
        elif mode in (Mode.RTL, Mode.LAND):
            if on_ground:
                self.disarm()
            else:
                self._command(self._executor.return_home if mode is Mode.RTL else self._executor.land)
        elif not on_ground or self.state.phase is not Phase.GROUND:
            self._command(self._executor.hold)

    def _fly_mission(self) -> None:
        if self._complete:
            self._executor.set_current(0)
        self._complete = False
        self._started = True
        self._command(self._executor.start)

    def _command(self, order: Callable[[], None]) -> None:
        """Give the executor an order; what it refuses is refused here."""
        try:
            order()
        except RefusedError:
            raise
        except VehicleError as error:
            raise RefusedError(str(error)) from None
        self.state = self._executor.state()

    def _end(self, outcome: Outcome, reason: str) -> None:
        self.outcome = outcome
        self.outcome_text = reason
