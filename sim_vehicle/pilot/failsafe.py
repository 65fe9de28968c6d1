"""Safety functions: pre-arm checks, and failsafes for battery, position, fence and link."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mission.outcome import Outcome
from sim_vehicle.autopilot.behaviour import Action, Mode
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.pilot.controls import Severity
from sim_vehicle.pilot.fence import Bounds, Breach, Fence, FenceWatch

if TYPE_CHECKING:
    from sim_vehicle.autopilot.behaviour import IdleDisarm
    from sim_vehicle.energy.battery import BatteryState
    from sim_vehicle.motion.legs import Position
    from sim_vehicle.pilot.controls import Controls

FORCE = 21196
"""Parameter 2 of MAV_CMD_COMPONENT_ARM_DISARM that skips the checks."""

_LEVEL_NAMES = ("", "low", "critical", "almost empty")
_ALMOST_EMPTY = 3


class BatteryWatch:
    """Watch over the battery level: 0 normal, 1 low, 2 critical, 3 almost empty.

    With `by_voltage`, a voltage that is too low for some time also makes the level low or critical, and the
    level never falls again before the next arming (ArduPilot). `reported` is the highest level since arming.
    """

    def __init__(self, controls: Controls, *, by_voltage: bool) -> None:
        self.reported = 0
        self._controls = controls
        self._parameters = controls.parameters
        self._by_voltage = by_voltage
        self._sagging_since_s = [math.inf, math.inf]

    def reset(self) -> None:
        """Reset the reported level when the vehicle arms."""
        self.reported = 0
        self._sagging_since_s = [math.inf, math.inf]

    def give_up(self) -> None:
        """Stop reporting levels, because the battery is empty or the vehicle is falling."""
        self.reported = _ALMOST_EMPTY

    def check(self) -> int:
        """Return the battery level if it is higher than all levels since arming, else 0."""
        battery = self._controls.state.battery
        if battery is None:
            return 0
        if self._by_voltage:
            self._time_low_voltages(battery)
        level = self.level()
        if level <= self.reported:
            return 0
        self.reported = level
        return level

    def level(self) -> int:
        """Return the present battery level."""
        battery, parameters = self._controls.state.battery, self._parameters
        if battery is None:
            return 0
        if battery.fraction < parameters.critical_fraction:
            almost = battery.fraction < min(parameters.emergency_fraction, parameters.critical_fraction)
            level = _ALMOST_EMPTY if almost or battery.depleted else 2
        else:
            level = int(battery.fraction < parameters.low_fraction)
        return max(level, self._voltage_level(), self.reported if self._by_voltage else 0)

    def describe(self, level: int) -> str:
        """Return the name of a level, and the charge or voltage that caused it."""
        battery, parameters = self._controls.state.battery, self._parameters
        assert battery is not None
        limit = parameters.low_fraction if level == 1 else parameters.critical_fraction
        amount = (
            f"{100.0 * battery.fraction:.0f} %" if battery.fraction < limit else f"{battery.voltage_v:.2f} V"
        )
        return f"{_LEVEL_NAMES[level]} ({amount})"

    def _voltage_level(self) -> int:
        """Return the battery level (0 to 2) for the time that the voltage has been below each threshold."""
        now_s, patience_s = self._controls.now_s, self._parameters.low_voltage_timer_s
        if patience_s <= 0.0:
            return 0
        low, critical = (now_s - since_s > patience_s for since_s in self._sagging_since_s)
        return 2 if critical else int(low)

    def _time_low_voltages(self, battery: BatteryState) -> None:
        """Record since when the voltage (under load, or corrected for the load) is below each threshold."""
        parameters, now_s = self._parameters, self._controls.now_s
        voltage = battery.rest_voltage_v if parameters.low_voltage_source == 1 else battery.voltage_v
        for i, limit in enumerate((parameters.low_voltage_v, parameters.critical_voltage_v)):
            since_s = self._sagging_since_s[i]
            self._sagging_since_s[i] = min(since_s, now_s) if voltage < limit else math.inf


_HOMING = (FlightPhase.RETURN, FlightPhase.LAND)
# Flight phases in which the vehicle already carries out an action or a stronger action, by action.
_DONE_IN = {Action.HOLD: _HOMING, Action.RETURN: _HOMING, Action.LAND: (FlightPhase.LAND,)}
# Bits of ArduPilot's parameter FENCE_TYPE.
_CEILING, _RADIUS, _AREAS = 1, 2, 4


@dataclass(frozen=True, slots=True)
class Reaction:
    """Action that a safety function demands from the pilot."""

    action: Action
    outcome: Outcome
    """Outcome of the run if the pilot takes the action."""
    reason: str
    return_point_m: Position | None = None
    """Place to which the vehicle returns instead of home, and holds: east, north, minimum height."""


def is_done(action: Action, phase: FlightPhase) -> bool:
    """Return whether a vehicle in this phase already carries out the action or a stronger action."""
    return phase in _DONE_IN.get(action, ())


class Failsafe:
    """Failsafes of one vehicle; the pilot carries out their reactions.

    `active` is true after a failsafe has triggered. `link_lost` is true while the ground station is silent.
    """

    def __init__(self, controls: Controls) -> None:
        self._rules = controls.rules
        self.battery = BatteryWatch(controls, by_voltage=controls.rules.watches_voltage)
        self.fence = FenceWatch()
        self.link_lost = False
        self.active = False
        self._controls = controls
        self._parameters = controls.parameters
        self._position_lost = False
        self._last_gcs_s = -math.inf
        self.apply_parameters()

    @property
    def fence_enabled(self) -> bool:
        """Whether the fence is enabled, with an action other than NONE."""
        parameters = self._parameters
        return bool(parameters.fence_enable) and self._rules.fence_action(parameters) is not Action.NONE

    def apply_parameters(self) -> None:
        """Apply the fence parameters."""
        parameters = self._parameters
        kinds = parameters.fence_type
        self.fence.change(
            bounds=Bounds(
                (parameters.fence_ceiling_m or math.inf) if kinds & _CEILING else math.inf,
                (parameters.fence_radius_m or math.inf) if kinds & _RADIUS else math.inf,
                bool(kinds & _AREAS),
            )
        )

    def set_fence(self, fence: Fence) -> None:
        """Replace the fence plan at once."""
        self.fence.change(fence)

    def on_gcs_heartbeat(self, now_s: float) -> None:
        """Record a heartbeat of a ground station, for the link timeout."""
        self._last_gcs_s = now_s
        if self.link_lost:
            self.link_lost = False
            if self._reports_link:
                self._controls.note(Severity.INFO, self._rules.link_regained)

    @property
    def _reports_link(self) -> bool:
        acts = self._rules.link_action(self._parameters) is not Action.NONE
        return acts or self._rules.tells_link_loss

    def on_armed(self) -> None:
        """Reset the failsafes when the vehicle arms."""
        self.active = self._position_lost = False
        self.battery.reset()

    def give_up(self) -> None:
        """Stop the battery failsafe, because the battery is empty or the vehicle is falling."""
        self.active = True
        self.battery.give_up()

    def outside(self, position_m: Position) -> str | None:
        """Return the reason why the fence excludes a position, or None if the fence allows it."""
        if not self.fence_enabled:
            return None
        breach, reason, _ = self.fence.evaluate(position_m, self._controls.home_m)
        return None if breach is Breach.NONE else reason

    def why_not_arm(self) -> str | None:
        """Return the reason why a failsafe prevents arming, or None."""
        reason = self.outside(self._controls.state.position_m)
        if reason is not None:
            return f"fence: {reason}"
        needs_link = self._rules.link_action(self._parameters) is not Action.NONE
        if needs_link and self._silence_s() > self._parameters.link_timeout_s:
            return "no connection to the ground control station"
        return None

    def check(self) -> Iterator[Reaction]:
        """Check all failsafes of an armed vehicle, and yield the reactions.

        The caller must carry out each reaction before it takes the next: later checks read the new state.
        """
        controls, parameters = self._controls, self._parameters
        if controls.state.phase.is_lost:
            return
        level = self.battery.check()
        if level > 0:
            yield from self._warn_of_battery(level)
        if controls.position_ok is self._position_lost:
            yield from self._check_position()
        silent = self._silence_s() > parameters.link_timeout_s
        if silent and not self.link_lost and self._last_gcs_s >= 0.0:
            yield from self._lose_link()
        if parameters.fence_enable:
            yield from self._check_fence()

    def _silence_s(self) -> float:
        return self._controls.now_s - self._last_gcs_s

    def _warn_of_battery(self, level: int) -> Iterator[Reaction]:
        action = self._rules.battery_action(level, self._parameters)
        homes = action is Action.RETURN and is_done(action, self._controls.state.phase)
        acts = action not in (Action.NONE, Action.WARN) and not homes
        text = self.battery.describe(level)
        severity = Severity.CRITICAL if level > 1 else Severity.WARNING
        self._controls.note(severity, f"Battery {text}" + (f": {action.value}" if acts else ""))
        yield from self._react(Reaction(action, Outcome.BATTERY_LOW, f"battery {text}"))

    def _check_position(self) -> Iterator[Reaction]:
        controls = self._controls
        self._position_lost = not controls.position_ok
        if controls.position_ok:
            self._controls.note(Severity.INFO, "Position regained")
            return
        if controls.landed is LandedState.ON_GROUND:
            return
        self._controls.note(Severity.CRITICAL, "Position lost: landing")
        yield from self._react(Reaction(Action.LAND, Outcome.POSITION_LOST, "position lost"))

    def _lose_link(self) -> Iterator[Reaction]:
        self.link_lost = True
        action = self._rules.link_action(self._parameters)
        goes_on = self._rules.mission_goes_on_bit & self._parameters.failsafe_options
        if action is not Action.NONE and goes_on and self._controls.mode is Mode.MISSION:
            self._controls.note(Severity.WARNING, self._rules.link_ignored)
            return
        acts = action is not Action.NONE and self._controls.landed is not LandedState.ON_GROUND
        if self._reports_link:
            done = f": {action.value}" if acts else ""
            self._controls.note(Severity.WARNING, self._rules.link_lost + done)
        yield from self._react(Reaction(action, Outcome.LINK_LOST, "ground station lost"))

    def _check_fence(self) -> Iterator[Reaction]:
        controls, watch = self._controls, self.fence
        if controls.landed is LandedState.ON_GROUND:
            return
        before, state = watch.breach, controls.state
        fresh = watch.check(state.position_m, state.path_length_m, controls.home_m, controls.now_s)
        if fresh:
            action = self._rules.fence_action(self._parameters)
            if action is Action.NONE:
                return
            self._controls.note(Severity.WARNING, self._rules.fence_text.format(watch.reason))
            point_m = watch.fence.return_point_m if action is Action.RETURN else None
            reaction = Reaction(action, Outcome.FENCE_BREACHED, f"fence: {watch.reason}", point_m)
            if point_m is None:
                yield from self._react(reaction)
            else:
                # As in ArduPlane, the return to the return point of the fence interrupts any flight.
                self.active = True
                yield reaction
        elif before is not Breach.NONE and watch.breach is Breach.NONE:
            self._controls.note(Severity.INFO, self._rules.fence_clear)

    def _react(self, reaction: Reaction) -> Iterator[Reaction]:
        """Yield the reaction, unless the vehicle already carries out its action or a stronger action."""
        action = reaction.action
        if action in (Action.NONE, Action.WARN) or self._controls.landed is LandedState.ON_GROUND:
            return
        if is_done(action, self._controls.state.phase):
            return
        self.active = True
        yield reaction


class ArmingChecks:
    """Pre-arm checks.

    The owner of the object may assign two attributes: `block` is a further reason against arming, and
    `custom_mode` is a function that returns the custom mode number.
    """

    def __init__(self, controls: Controls, failsafe: Failsafe) -> None:
        self.block: str | None = None
        self.custom_mode: Callable[[], int] = lambda: controls.firmware.mavlink.modes[controls.mode]
        self._controls = controls
        self._failsafe = failsafe

    def health_problem(self) -> str | None:
        """Return the reason that prevents arming in every mode, or None."""
        controls = self._controls
        if not controls.position_ok:
            return "no position"
        if not controls.motor_ok:
            return "motor failure"
        reason = self.block or self._battery_problem() or self._failsafe.why_not_arm()
        return reason or controls.behaviour.refuses_to_arm(
            controls.executor.mission.items, controls.parameters
        )

    def why_not(self, mode: Mode, mission_problem: str | None) -> str | None:
        """Return the reason that prevents arming in this mode, or None.

        `mission_problem` is the reason why the mission cannot be flown, or None.
        """
        problem = self.health_problem()
        if problem is not None:
            return problem
        controls = self._controls
        if mode is Mode.MISSION and not controls.executor.mission.items:
            return mission_problem
        by_mode = controls.firmware.mavlink.modes.why_not_arm(self.custom_mode(), controls.parameters)
        if by_mode is not None:
            return by_mode
        if mode in (Mode.RTL, Mode.LAND, Mode.FLIP, Mode.FOLLOW):
            return f"mode {mode.value} does not allow arming: choose another mode"
        return mission_problem if mode is Mode.MISSION else None

    def _battery_problem(self) -> str | None:
        battery, parameters = self._controls.state.battery, self._controls.parameters
        if battery is None:
            return None
        if battery.fraction < max(parameters.low_fraction, 1e-9):
            return f"battery low ({100.0 * battery.fraction:.0f} %)"
        if self._controls.rules.watches_voltage:
            least = max(parameters.low_voltage_v, parameters.critical_voltage_v)
            if battery.voltage_v < least:
                return f"battery voltage low ({battery.voltage_v:.2f} V, least {least:.2f} V)"
        return None


class IdleWatch:
    """Timer of a vehicle that idles on the ground; when the time is over, the vehicle must be disarmed.

    `throttle_down` is a function that returns True if no stick demands thrust.
    """

    def __init__(self, controls: Controls, rule: IdleDisarm, throttle_down: Callable[[], bool]) -> None:
        self._controls = controls
        self._rule = rule
        self._throttle_down = throttle_down
        self._since_s = 0.0
        self._has_flown = False

    @property
    def texts(self) -> tuple[str, ...]:
        """Notices to send when the time is over."""
        return self._rule.texts

    def on_armed(self) -> None:
        """Start the timer."""
        self._since_s, self._has_flown = self._controls.now_s, False

    def is_over(self) -> bool:
        """Whether the armed vehicle has been on the ground for too long."""
        controls, rule = self._controls, self._rule
        stands = controls.landed is LandedState.ON_GROUND and controls.state.phase is FlightPhase.GROUND
        self._has_flown |= not stands
        if not stands or (not rule.first_flight and not self._throttle_down()):
            self._since_s = controls.now_s
            return False
        delay_s = rule.delay.of(controls.parameters)
        waits = delay_s > 0.0 and not (rule.first_flight and self._has_flown)
        return waits and controls.now_s - self._since_s >= delay_s
