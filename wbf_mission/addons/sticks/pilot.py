"""Manual flight by the sticks of a ground station, and the failsafe on a loss of the sticks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress

from mission.outcome import Outcome
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.behaviour import Action, Mode
from sim_vehicle.autopilot.stick_rules import StickRules, Sticks, TiltSticks, WingSticks
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.motion.legs import KEEP, Heading
from sim_vehicle.pilot.controls import Controls, RefusedError, Severity
from sim_vehicle.pilot.failsafe import Reaction, is_done

# After a gap longer than this, manual flight restarts from the present motion.
_LONGEST_STEP_S = 0.5
# Largest simulated lean; a vehicle therefore cannot flip.
_MOST_LEAN_RAD = math.radians(70.0)


class StickTilt:
    """Turns the positions of sticks that lean the vehicle into velocity orders."""

    def __init__(self, controls: Controls, rules: TiltSticks) -> None:
        self._controls = controls
        self._parameters = controls.parameters
        self._rules = rules
        self._velocity_m_s = (0.0, 0.0, 0.0)
        self._lean_rad = (0.0, 0.0)
        self._height_m: float | None = None
        self._flown_s = -math.inf

    def forget(self) -> None:
        """Restart from the present motion at the next call."""
        self._flown_s = -math.inf

    def fly(self, sticks: Sticks, climb_m_s: float | None, heading: Heading, *, by_rate: bool) -> None:
        """Fly by the sticks.

        `climb_m_s` is the vertical speed; 0 holds the height, and None takes the throttle stick as thrust. If
        `by_rate`, the sticks command roll and pitch rates, and centred sticks keep the lean (ACRO).
        """
        controls, rules = self._controls, self._rules
        state = controls.state
        step_s = controls.now_s - self._flown_s
        if step_s > _LONGEST_STEP_S:
            self._velocity_m_s, self._lean_rad, self._height_m = state.velocity_m_s, (0.0, 0.0), None
            step_s = 0.0
        if step_s == 0.0 and self._flown_s == controls.now_s:
            return
        self._flown_s = controls.now_s
        forward_rad, right_rad = self._lean_rad = self._lean(sticks, step_s, by_rate=by_rate)
        thrust = 1.0 if climb_m_s is not None else self._thrust(sticks.up)
        lean_rad = math.hypot(forward_rad, right_rad)
        if climb_m_s is not None:
            # The stick commands acceleration: thrust grows with the lean, so that lift stays the same.
            most_rad = min(rules.lean.of(self._parameters), _MOST_LEAN_RAD)
            scale = GRAVITY_M_S2 * math.tan(most_rad) / most_rad
        else:
            scale = GRAVITY_M_S2 * thrust * math.sin(lean_rad) / lean_rad if lean_rad > 0.0 else 0.0
        ahead, aside = scale * forward_rad, scale * right_rad
        yaw = state.yaw_rad
        drag = rules.drag(controls.spec)
        wind_east, wind_north = state.wind_m_s
        east, north, up = self._velocity_m_s
        east = _fall(east, wind_east, ahead * math.sin(yaw) + aside * math.cos(yaw), drag, step_s)
        north = _fall(north, wind_north, ahead * math.cos(yaw) - aside * math.sin(yaw), drag, step_s)
        size = max(math.hypot(east, north) / controls.spec.top_speed_m_s, 1.0)
        east, north = east / size, north / size
        if climb_m_s is None:
            up = _fall(up, 0.0, GRAVITY_M_S2 * (thrust * math.cos(lean_rad) - 1.0), drag, step_s)
            up = min(max(up, -controls.spec.descent_speed_m_s), controls.spec.climb_speed_m_s)
        else:
            up = climb_m_s
        self._velocity_m_s = (east, north, up)
        self._order(climb_m_s, heading)

    def _order(self, climb_m_s: float | None, heading: Heading) -> None:
        controls = self._controls
        east, north, up = self._velocity_m_s
        if controls.landed is LandedState.ON_GROUND and up <= 0.0:
            self._velocity_m_s = (0.0, 0.0, 0.0)
            return
        state = controls.state
        if climb_m_s != 0.0:
            self._height_m = None
        elif self._height_m is None and abs(state.velocity_m_s[2]) < self._rules.hold_below.of(
            self._parameters
        ):
            self._height_m = state.position_m[2]
        height_m = math.nan if self._height_m is None else self._height_m
        executor = controls.executor
        controls.order(lambda: executor.steer((east, north, up), height_m=height_m, heading=heading))

    def _lean(self, sticks: Sticks, step_s: float, *, by_rate: bool) -> tuple[float, float]:
        """Return the lean forward and to the right (rad)."""
        rules, parameters = self._rules, self._parameters
        if by_rate:
            forward, right = self._lean_rad
            forward += step_s * rules.pitch_rate.of(parameters) * sticks.forward
            right += step_s * rules.roll_rate.of(parameters) * sticks.right
            most = _MOST_LEAN_RAD
        else:
            most = min(rules.lean.of(parameters), _MOST_LEAN_RAD)
            forward, right = most * sticks.forward, most * sticks.right
        size = max(math.hypot(forward, right) / most, 1.0)
        return forward / size, right / size

    def _thrust(self, up: float) -> float:
        """Return the thrust that the throttle stick commands, in units of the hover thrust."""
        rules, parameters = self._rules, self._parameters
        hover = rules.hover_thrust.of(parameters)
        end = (rules.most_thrust if up > 0.0 else rules.least_thrust).of(parameters)
        return 1.0 + abs(up) * (end / hover - 1.0)


def _fall(speed: float, air_speed: float, acceleration: float, drag_1_s: float, step_s: float) -> float:
    """Return the speed after a time under constant acceleration and drag linear in the airspeed."""
    if drag_1_s <= 0.0:
        return speed + acceleration * step_s
    final = air_speed + acceleration / drag_1_s
    return final + (speed - final) * math.exp(-drag_1_s * step_s)


# Length of a straight path, and distance after which a new straight path is ordered.
_AHEAD_M, _AGAIN_M = 2000.0, 1000.0
# Bank below which a straight path is flown; minimum height of a path; maximum circle radius; resolution of
# stick positions (a smaller change gives no new order).
_LEAST_BANK_RAD = math.radians(1.5)
_LOWEST_M, _WIDEST_M = 5.0, 1000.0
_STEP = 0.02


class StickWing:
    """Turns stick positions into orders to fly circles and straight paths."""

    def __init__(self, controls: Controls) -> None:
        self._controls = controls
        self._parameters = controls.parameters
        self._flown: tuple[int, int] | None = None
        self._from_m = (0.0, 0.0)

    def forget(self) -> None:
        """Forget the last order, so that the next call gives an order again."""
        self._flown = None

    def fly(self, limits: WingSticks, bank: float, pitch: float) -> None:
        """Fly at fractions (-1 to 1) of the maximum bank and pitch; this has no effect on the ground."""
        controls = self._controls
        state = controls.state
        if controls.landed is LandedState.ON_GROUND:
            return
        x, y, z = state.position_m
        asked = (round(bank / _STEP), round(pitch / _STEP))
        bank_rad = bank * limits.bank.of(self._parameters)
        turns = abs(bank_rad) > _LEAST_BANK_RAD
        if asked == self._flown and (turns or math.dist(self._from_m, (x, y)) < _AGAIN_M):
            return
        slope = pitch * self._steepest(limits, upward=pitch > 0.0)
        height = min(max(z + _AHEAD_M * slope, _LOWEST_M), controls.spec.max_altitude_m)
        east, north, _ = state.velocity_m_s
        course = math.atan2(east, north)
        executor = controls.executor
        if turns:
            speed = controls.spec.cruise_speed_m_s
            radius = min(speed**2 / (GRAVITY_M_S2 * math.tan(abs(bank_rad))), _WIDEST_M)
            side = math.copysign(radius, bank_rad)
            centre = (x + side * math.cos(course), y - side * math.sin(course))
            controls.order(lambda: executor.orbit(*centre, height, side, speed))
        else:
            target = (x + _AHEAD_M * math.sin(course), y + _AHEAD_M * math.cos(course))
            controls.order(lambda: executor.goto(*target, height))
        self._flown, self._from_m = asked, (x, y)

    def _steepest(self, limits: WingSticks, *, upward: bool) -> float:
        """Return the slope of the path at full stick."""
        end = abs((limits.up if upward else limits.down).of(self._parameters))
        return end / self._controls.spec.cruise_speed_m_s if limits.by_rate else math.tan(end)


# Rank of an action by severity.
_severity = (
    *(Action.NONE, Action.WARN, Action.HOLD, Action.RETURN),
    *(Action.LAND, Action.DISARM, Action.TERMINATE),
).index
# A rover under stick control is ordered the course that it would have after this time.
_STEERS_AHEAD_S = 0.5
# Stick position of 90 % throttle, ArduPlane's threshold for a go-around (``Plane::update_flight_stage``).
_FULL_THROTTLE = 0.8
# RC3_DZ: 30 microseconds of 500 above the lower end.
_DOWN = -0.94


class StickPilot:
    """Manual flight while stick messages arrive; `lost` is true if the messages have stopped."""

    def __init__(self, controls: Controls, rules: StickRules) -> None:
        self._controls = controls
        self._parameters = controls.parameters
        self._rules = rules
        self._sticks: Sticks | None = None
        self._shown = Sticks()
        self._heard_s = -math.inf
        self._moves = False
        self.lost = False
        self._wing = StickWing(controls) if rules.wings else None
        self._tilt = StickTilt(controls, rules.tilt) if rules.tilt is not None else None
        self._by_rate = False
        self._later: tuple[float, Reaction] | None = None
        self._left: Mode | None = None

    def take(self, sticks: Sticks, *, flown: bool = True, by_rate: bool = False) -> Mode | None:
        """Fly by the sticks; centred sticks stop the vehicle.

        `flown` says whether the sticks move the vehicle in the custom mode, and `by_rate` whether the sticks
        command rates. If the vehicle holds after a loss of the sticks, return the mode to resume.
        """
        self._heard_s = self._controls.now_s
        self._shown = sticks
        self._sticks = sticks if flown else Sticks()
        self._by_rate = by_rate
        left, was_lost = self._left, self.lost
        self.lost, self._later, self._left = False, None, None
        if was_lost:
            self._controls.note(Severity.WARNING, self._rules.loss.regained)
        if was_lost and left is not None and self._controls.mode is Mode.HOLD:
            return left
        if flown and self._flies:
            self._fly(sticks)
        return None

    def forget(self) -> None:
        """Reset on arming: sticks that are silent at the time of arming do not count as lost."""
        if self._silence_s > self._rules.loss.timeout.of(self._parameters):
            self._sticks, self.lost = None, False
        self._later = self._left = None

    @property
    def heard(self) -> bool:
        """Whether stick messages arrive."""
        return self._sticks is not None and self._silence_s <= self._rules.loss.timeout.of(self._parameters)

    @property
    def shown(self) -> Sticks | None:
        """Stick positions, whether they move the vehicle or not; None while no messages arrive."""
        return self._shown if self.heard else None

    @property
    def throttle_down(self) -> bool:
        """Whether the throttle stick is at its lower end, or absent."""
        return not self.heard or (self._sticks is not None and self._sticks.up <= _DOWN)

    def lacks(self, mode: Mode) -> bool:
        """Whether a mode does not exist for the vehicle, or needs sticks that are absent."""
        return mode in self._rules.impossible or (mode in self._rules.needed and not self.heard)

    def why_not_arm(self, mode: Mode) -> str | None:
        """Return the reason why the sticks prevent arming, or None."""
        arming = self._rules.loss.arming
        if arming is not None and arming.of(self._parameters) and self._sticks is not None and not self.heard:
            return "Radio failsafe on"
        if mode in self._rules.impossible:
            return "Mode not supported"
        return "No manual control input" if self.lacks(mode) else None

    def check(self, *, flown: bool) -> Iterator[Reaction]:
        """Continue manual flight, and yield reactions to a loss of the sticks (`flown`: see `take`)."""
        if self._sticks is None:
            receiver, controls = self._rules.receiver, self._controls
            holds = controls.state.phase is FlightPhase.HOLD and controls.landed is LandedState.IN_AIR
            if receiver is not None and flown and self._flies and holds:
                with suppress(RefusedError):
                    self._fly(receiver)
            return
        loss = self._rules.loss
        if self._later is not None and self._controls.now_s >= self._later[0]:
            reaction, self._later, self._left = self._later[1], None, None
            if self._controls.mode is Mode.HOLD:
                self._controls.note(Severity.CRITICAL, loss.lost)
                yield reaction
        if self._silence_s <= self._limit_s:
            if self._wing is not None and not self._flies:
                self._wing.forget()
            if self._tilt is not None and not self._leans:
                self._tilt.forget()
            # A rover or a fixed-wing vehicle needs new orders even if the sticks do not move.
            steers_on = self._moves and (self._rules.drives or self._wing is not None)
            if self._flies and (self._leans or steers_on):
                with suppress(RefusedError):
                    self._fly(self._sticks)
        elif not self.lost:
            self.lost = True
            yield from self._lose()

    @property
    def breaks_off_landing(self) -> bool:
        """Whether the throttle stick demands a go-around."""
        switch, sticks = self._rules.landing_abort, self._sticks
        asks = sticks is not None and sticks.up >= _FULL_THROTTLE and self._controls.mode is Mode.MISSION
        return asks and switch is not None and switch.of(self._parameters) != 0.0

    @property
    def _silence_s(self) -> float:
        return self._controls.now_s - self._heard_s

    @property
    def _action(self) -> Action:
        """Action that a loss of the sticks triggers in the present mode."""
        loss = self._rules.loss
        action = loss.actions.get(int(loss.action.of(self._parameters)), Action.NONE)
        return max(action, loss.in_stick_modes, key=_severity) if self._flies else action

    @property
    def _limit_s(self) -> float:
        """Time without stick messages (s) after which the sticks count as lost or released."""
        loss = self._rules.loss
        if loss.release is None or self._action is not Action.NONE:
            return loss.timeout.of(self._parameters)
        release_s = loss.release.of(self._parameters)
        return math.inf if release_s < 0.0 else release_s

    @property
    def _leans(self) -> bool:
        """Whether the sticks lean the vehicle in the present mode."""
        tilt, mode = self._rules.tilt, self._controls.mode
        return tilt is not None and mode in tilt.holds_height | tilt.by_throttle

    @property
    def _flies(self) -> bool:
        return self._controls.armed and self._controls.mode in self._rules.speeds

    def _lose(self) -> Iterator[Reaction]:
        loss, mode, controls, action = self._rules.loss, self._controls.mode, self._controls, self._action
        if action is Action.NONE:
            self._stop()
            return
        if controls.landed is LandedState.ON_GROUND:
            if loss.on_ground is not Action.NONE:
                self._controls.note(Severity.WARNING, f"{loss.lost} - Disarming")
                yield Reaction(loss.on_ground, Outcome.LINK_LOST, "sticks lost")
            return
        if loss.exceptions.get(mode, 0) & self._parameters.failsafe_options:
            self._controls.note(Severity.WARNING, loss.ignored.get(mode, ""))
            return
        if is_done(action, controls.state.phase):
            return
        reaction = Reaction(action, Outcome.LINK_LOST, "sticks lost")
        delay_s = 0.0 if loss.delay is None else loss.delay.of(self._parameters)
        self._moves = False
        if delay_s > 0.0 and _severity(action) > _severity(Action.HOLD):
            self._controls.note(Severity.CRITICAL, loss.delayed.format(delay_s))
            self._later, self._left = (controls.now_s + delay_s, reaction), mode
            yield Reaction(Action.HOLD, Outcome.RUNNING, "")
            return
        self._controls.note(Severity.CRITICAL, loss.lost)
        yield reaction

    def _fly(self, sticks: Sticks) -> None:
        rules, controls = self._rules, self._controls
        spec, yaw = controls.spec, controls.state.yaw_rad
        setting = rules.speeds[self._controls.mode]
        wanted = math.inf if setting is None else setting.of(self._parameters)
        speed = min(wanted, spec.top_speed_m_s)
        if rules.drives:
            self._drive(speed * rules.vertical.share(sticks.up), rules.turning.share(sticks.right))
            return
        if self._tilt is not None and rules.tilt is not None and self._leans:
            self._lean(self._tilt, rules.tilt, sticks)
            return
        forward, right = rules.level.share(sticks.forward), rules.level.share(sticks.right)
        if self._wing is not None:
            self._wing.fly(rules.wings[self._controls.mode], right, -forward)
            self._moves = True
            return
        up, turn = rules.vertical.share(sticks.up), rules.turning.share(sticks.turn)
        if controls.landed is LandedState.ON_GROUND and not (up > 0.0 and sticks.up > rules.takeoff_stick):
            return
        if not any((forward, right, up, turn)):
            self._stop()
            return
        east = speed * (forward * math.sin(yaw) + right * math.cos(yaw))
        north = speed * (forward * math.cos(yaw) - right * math.sin(yaw))
        climb = up * self._vertical_speed(upward=up > 0.0)
        heading = Heading.turning(turn * rules.turn_rate.of(self._parameters)) if turn else KEEP
        self._steer((east, north, climb), heading)

    def _lean(self, pilot: StickTilt, tilt: TiltSticks, sticks: Sticks) -> None:
        """Lean by the sticks, and turn and climb as the mode requires."""
        rules, controls = self._rules, self._controls
        climb = None
        if self._controls.mode in tilt.holds_height:
            share = rules.vertical.share(sticks.up)
            climb = share * self._vertical_speed(upward=share > 0.0)
            if controls.landed is LandedState.ON_GROUND and not sticks.up > rules.takeoff_stick:
                return
        turn_rate = (tilt.yaw_rate if self._by_rate else rules.turn_rate).of(self._parameters)
        turn = rules.turning.share(sticks.turn)
        heading = Heading.turning(turn * turn_rate) if turn else KEEP
        pilot.fly(sticks, climb, heading, by_rate=self._by_rate)

    def _vertical_speed(self, *, upward: bool) -> float:
        """Return the vertical speed at full stick."""
        rules, spec = self._rules, self._controls.spec
        climb_m_s = rules.climb.of(self._parameters) if rules.climb is not None else 0.0
        descent_m_s = rules.descent.of(self._parameters) if rules.descent is not None else 0.0
        if upward:
            return min(climb_m_s or math.inf, spec.climb_speed_m_s)
        return min(descent_m_s or climb_m_s or math.inf, spec.descent_speed_m_s)

    def _drive(self, speed_m_s: float, steering: float) -> None:
        """Drive forward and turn in proportion to the speed; a backward stick only stops the vehicle."""
        if speed_m_s <= 0.0:
            self._stop()
            return
        share = speed_m_s / self._controls.spec.top_speed_m_s
        most = self._rules.turn_rate.of(self._parameters) or self._controls.spec.yaw_rate_rad_s
        rate = steering * share * most
        course = self._controls.state.yaw_rad + rate * _STEERS_AHEAD_S
        self._steer((speed_m_s * math.sin(course), speed_m_s * math.cos(course), 0.0), KEEP)

    def _steer(self, velocity_m_s: tuple[float, float, float], heading: Heading) -> None:
        executor = self._controls.executor
        self._controls.order(lambda: executor.steer(velocity_m_s, heading=heading))
        self._moves = True

    def _stop(self) -> None:
        if self._moves and self._flies:
            with suppress(RefusedError):  # the vehicle may have landed meanwhile
                self._controls.order(self._controls.executor.flight.hold)
        self._moves = False
