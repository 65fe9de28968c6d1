"""Watches over a flight: battery, position, fence, ground link; each has its level, its text, its action."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.failsafe_rules import Action, FailsafeRules
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.state import LandedState, Phase
from sim_vehicle.pilot.fence import Bounds, Breach, Fence, FenceWatch
from sim_vehicle.pilot.modes import Outcome
from sim_vehicle.pilot.notices import Severity

if TYPE_CHECKING:
    from sim_vehicle.energy.battery import BatteryState
    from sim_vehicle.pilot.pilot import Pilot

__all__ = ["Failsafe"]

_LEVELS = ("", "low", "critical", "almost empty")
_MODES = {Action.HOLD: Mode.HOLD, Action.RETURN: Mode.RTL, Action.LAND: Mode.LAND}
# FENCE_TYPE of ArduPilot.
_CEILING, _RADIUS, _AREAS = 1, 2, 4


class Failsafe:
    """The safety functions of one vehicle.

    Parameters
    ----------
    pilot : Pilot
        Who is watched, and acts.
    rules : FailsafeRules
        What the autopilot does.

    Attributes
    ----------
    active : bool
        Whether one of them has taken over since the vehicle was armed.
    fence : FenceWatch
    link_lost : bool
        Whether the ground station was heard once and is no more.
    """

    def __init__(self, pilot: Pilot, rules: FailsafeRules) -> None:
        self.rules = rules
        self.fence = FenceWatch()
        self.link_lost = False
        self.active = False
        self._pilot = pilot
        self._battery_level = 0
        self._sagging_since_s = [math.inf, math.inf]
        self._position_lost = False
        self._heard_s = -math.inf
        self.apply_parameters()

    @property
    def fence_enabled(self) -> bool:
        """Whether the fence is watched at all."""
        pilot = self._pilot
        return (
            bool(pilot.parameters.fence_enable)
            and self.rules.fence_action(pilot.parameters) is not Action.NONE
        )

    def apply_parameters(self) -> None:
        """Take the parameters of the fence."""
        parameters = self._pilot.parameters
        kinds = parameters.fence_type
        self.fence.change(
            bounds=Bounds(
                (parameters.fence_ceiling_m or math.inf) if kinds & _CEILING else math.inf,
                (parameters.fence_radius_m or math.inf) if kinds & _RADIUS else math.inf,
                bool(kinds & _AREAS),
            )
        )

    def set_fence(self, fence: Fence) -> None:
        """Take another fence plan; it holds at once."""
        self.fence.change(fence)

    def on_gcs_heartbeat(self, now_s: float) -> None:
        """Note a heartbeat of a ground station."""
        self._heard_s = now_s
        if self.link_lost:
            self.link_lost = False
            self._pilot.note(Severity.INFO, self.rules.link_regained)

    def armed(self) -> None:
        """Begin again with the arming."""
        self.active = self._position_lost = False
        self._battery_level = 0
        self._sagging_since_s = [math.inf, math.inf]

    def gave_out(self) -> None:
        """Note that the battery is empty or the vehicle falls: nothing more can be done."""
        self.active = True
        self._battery_level = 3

    def outside(self, place_m: tuple[float, float, float]) -> str | None:
        """Return why the fence does not allow a place, None when it does."""
        if not self.fence_enabled:
            return None
        breach, reason, _ = self.fence.judge(place_m, self._pilot.home_m)
        return None if breach is Breach.NONE else reason

    def why_not_arm(self) -> str | None:
        """Return what a safety function has against arming."""
        pilot = self._pilot
        reason = self.outside(pilot.state.position_m)
        if reason is not None:
            return f"fence: {reason}"
        needs_link = self.rules.link_action(pilot.parameters) is not Action.NONE
        if needs_link and self._silence_s() > pilot.parameters.link_timeout_s:
            return "no connection to the ground control station"
        return None

    def check(self) -> None:
        """Look at everything and act on what is new; the vehicle is armed."""
        pilot = self._pilot
        if pilot.state.phase.is_lost:
            return
        self._check_battery()
        if pilot.position_ok is self._position_lost:
            self._check_position()
        if (
            self._silence_s() > pilot.parameters.link_timeout_s
            and not self.link_lost
            and self._heard_s >= 0.0
        ):
            self._lose_link()
        if pilot.parameters.fence_enable:
            self._check_fence()

    def _silence_s(self) -> float:
        return self._pilot.now_s - self._heard_s

    def battery_level(self) -> int:
        """Return how the battery is: 0 fine, 1 low, 2 critical, 3 almost empty."""
        battery, parameters = self._pilot.state.battery, self._pilot.parameters
        if battery is None:
            return 0
        if battery.fraction < parameters.critical_fraction:
            almost = battery.fraction < min(parameters.emergency_fraction, parameters.critical_fraction)
            level = 3 if almost or battery.depleted else 2
        else:
            level = int(battery.fraction < parameters.low_fraction)
        # An ArduPilot does not take back what it said when the voltage recovers.
        said = self._battery_level if self.rules.watches_voltage else 0
        return max(level, self._voltage_level(), said)

    def _voltage_level(self) -> int:
        """Return what a voltage means that was too low for the time of the parameter, 0 to 2."""
        now_s, patience_s = self._pilot.now_s, self._pilot.parameters.low_voltage_timer_s
        if patience_s <= 0.0:
            return 0
        low, critical = (now_s - since_s > patience_s for since_s in self._sagging_since_s)
        return 2 if critical else int(low)

    def _check_voltage(self, battery: BatteryState) -> None:
        """Note since when the voltage is too low, as it is under load or without the sag."""
        parameters, now_s = self._pilot.parameters, self._pilot.now_s
        voltage = battery.rest_voltage_v if parameters.low_voltage_source == 1 else battery.voltage_v
        for i, limit in enumerate((parameters.low_voltage_v, parameters.critical_voltage_v)):
            since_s = self._sagging_since_s[i]
            self._sagging_since_s[i] = min(since_s, now_s) if voltage < limit else math.inf

    def _check_battery(self) -> None:
        pilot = self._pilot
        battery, parameters = pilot.state.battery, pilot.parameters
        if battery is None:
            return
        if self.rules.watches_voltage:
            self._check_voltage(battery)
        level = self.battery_level()
        if level <= self._battery_level:
            return
        self._battery_level = level
        action = self.rules.battery_action(level, parameters)
        homing = pilot.state.phase in (Phase.RETURN, Phase.LAND)
        acts = action not in (Action.NONE, Action.WARN) and not (homing and action is Action.RETURN)
        by_charge = battery.fraction < (
            parameters.low_fraction if level == 1 else parameters.critical_fraction
        )
        amount = f"{100.0 * battery.fraction:.0f} %" if by_charge else f"{battery.voltage_v:.2f} V"
        text = f"{_LEVELS[level]} ({amount})"
        severity = Severity.CRITICAL if level > 1 else Severity.WARNING
        pilot.note(severity, f"Battery {text}" + (f": {action.value}" if acts else ""))
        self._act(action, Outcome.BATTERY_LOW, f"battery {text}")

    def _check_position(self) -> None:
        pilot = self._pilot
        self._position_lost = not pilot.position_ok
        if pilot.position_ok:
            pilot.note(Severity.INFO, "Position regained")
            return
        if pilot.landed is LandedState.ON_GROUND:
            return
        pilot.note(Severity.CRITICAL, "Position lost: landing")
        self._act(Action.LAND, Outcome.POSITION_LOST, "position lost")

    def _lose_link(self) -> None:
        pilot = self._pilot
        self.link_lost = True
        action = self.rules.link_action(pilot.parameters)
        acts = action is not Action.NONE and pilot.landed is not LandedState.ON_GROUND
        pilot.note(Severity.WARNING, self.rules.link_lost + (f": {action.value}" if acts else ""))
        self._act(action, Outcome.LINK_LOST, "ground station lost")

    def _check_fence(self) -> None:
        pilot, watch = self._pilot, self.fence
        if pilot.landed is LandedState.ON_GROUND:
            return
        before, state = watch.breach, pilot.state
        fresh = watch.check(state.position_m, state.path_length_m, pilot.home_m, pilot.now_s)
        if fresh:
            action = self.rules.fence_action(pilot.parameters)
            if action is Action.NONE:
                return
            pilot.note(Severity.WARNING, self.rules.fence_text.format(watch.reason))
            if action is Action.RETURN and watch.fence.return_point_m is not None:
                self._go_back(watch.fence.return_point_m)
            else:
                self._act(action, Outcome.FENCE_BREACHED, f"fence: {watch.reason}")
        elif before is not Breach.NONE and watch.breach is Breach.NONE:
            pilot.note(Severity.INFO, self.rules.fence_clear)

    def _go_back(self, point_m: tuple[float, float, float]) -> None:
        """Return to the fence's own point and hold there, as ArduPlane does."""
        self.active = True
        self._pilot.end(Outcome.FENCE_BREACHED, f"fence: {self.fence.reason}")
        self._pilot.return_to(point_m)

    def _act(self, action: Action, outcome: Outcome, reason: str) -> None:
        """Do what the action says, unless the vehicle is already at something stronger."""
        pilot = self._pilot
        if action in (Action.NONE, Action.WARN) or pilot.landed is LandedState.ON_GROUND:
            return
        phase = pilot.state.phase
        stronger = {Action.LAND: (Phase.LAND,), Action.TERMINATE: ()}.get(action, (Phase.RETURN, Phase.LAND))
        if phase in stronger:
            return
        self.active = True
        pilot.end(outcome, reason)
        if action is Action.TERMINATE:
            pilot.terminate(reason)
        else:
            pilot.turn_to(_MODES[action])
