"""Guided flight, follow me, CIRCLE, FLIP, orbits and further commands, as an extra of the vehicle."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, get_args

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.parameters import Setting
from sim_vehicle.execution.state import LandedState
from sim_vehicle.mavlink.commands import enter_mode
from sim_vehicle.mavlink.extras import VehicleExtra
from sim_vehicle.motion.legs import ALONG, INWARD, KEEP, Heading
from sim_vehicle.pilot.controls import RefusedError
from wbf_mission.addons.modes.follow import FollowPilot
from wbf_mission.addons.modes.guided import Flip, GuidedFlight
from wbf_mission.addons.modes.steering import SetpointMessage, Steering

if TYPE_CHECKING:
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.mavlink.vehicle_command import Result, VehicleCommand
    from sim_vehicle.mavlink.wire_state import WireState

__all__ = ["ModesExtra"]

_BY_HAND = (Mode.MANUAL, Mode.ALTITUDE)
# ArduCopter does not begin a flip if the sticks command a lean of more than 40 of 45 degrees.
_MAX_FLIP_STICK = 40.0 / 45.0
_CIRCLE_RADIUS = Setting("CIRCLE_RADIUS", 1000.0, 0.01)
_CIRCLE_RATE = Setting("CIRCLE_RATE", 20.0, math.radians(1.0))
_CIRCLE_OPTIONS, _LOOKS_ALONG, _BEGINS_AT_CENTER = Setting("CIRCLE_OPTIONS", 1.0), 2, 4
_ORBIT_HEADING = Setting("MC_ORBIT_YAW_MOD", 0.0)
_STANDARD_MODES = {
    1: Mode.HOLD,
    4: Mode.ALTITUDE,
    5: Mode.RTL,
    6: Mode.MISSION,
    7: Mode.LAND,
    8: Mode.TAKEOFF,
}
_POLE, _DATE_LINE = 90.0, 180.0
# Type masks that use only the position, only the velocity, or both.
_ONLY_POSITION, _ONLY_VELOCITY, _BOTH = 0xDF8, 0xC07, 0xC00


class ModesExtra(VehicleExtra):
    """Adds the modes that no mission needs, if the firmware has them."""

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        super().__init__(state, parameters, plans)
        self._pilot = state.pilot
        self.guided = GuidedFlight(state.pilot)
        self._follow = FollowPilot(state.pilot)
        self._before_flip = state.pilot.mode
        self._points_inward = False
        self.commands = {
            m.MAV_CMD_DO_ORBIT: self._orbit,
            Command.CONDITION_YAW: self._yaw,
            m.MAV_CMD_DO_CHANGE_ALTITUDE: self._change_altitude,
            m.MAV_CMD_DO_GO_AROUND: self._go_around,
            m.MAV_CMD_DO_SET_STANDARD_MODE: self._standard_mode,
        }
        self.builders = {m.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: self._position_target}
        steering = Steering(state, self.guided)
        handlers: dict[int, Callable[[Any, float], None]] = {
            kind.id: steering.take for kind in get_args(SetpointMessage)
        }
        if Mode.FOLLOW in state.mavlink.modes.numbers:
            handlers[m.MAVLink_follow_target_message.id] = self._take_target
        self.handlers = handlers

    def why_not_enter(self, mode: Mode) -> str | None:
        """Return the reason why a flip or PX4's OFFBOARD cannot begin now, or None."""
        if mode is Mode.FLIP and not self._may_flip:
            return "not flying by hand"
        return "no setpoints" if self._lacks_stream(mode) else None

    def why_not_arm(self, mode: Mode) -> str | None:
        """Return the reason against arming in PX4's OFFBOARD, or None."""
        return "No offboard signal" if self._lacks_stream(mode) else None

    def _lacks_stream(self, mode: Mode) -> bool:
        return mode is Mode.GUIDED and self._pilot.rules.needs_stream and not self.guided.setpoints.is_fresh

    @property
    def _may_flip(self) -> bool:
        """Whether ArduCopter would begin a flip (``ModeFlip::init``)."""
        pilot = self._pilot
        if not pilot.armed or pilot.landed is LandedState.ON_GROUND or pilot.mode not in _BY_HAND:
            return False
        if pilot.firmware.sticks is None:
            return True
        if pilot.mode is Mode.MANUAL and pilot.throttle_down:
            return False
        return pilot.sticks is None or abs(pilot.sticks.right) < _MAX_FLIP_STICK

    def start(self, mode: Mode) -> None:
        """Begin to fly the latest setpoint in a mode that needs a stream of setpoints."""
        if mode is Mode.GUIDED:
            self._pilot.order(self.guided.setpoints.begin)

    def begin(self, mode: Mode, before: Mode) -> None:
        """Begin a mode: hold an attitude, flip, circle, or wait for a target."""
        pilot = self._pilot
        if mode is Mode.ATTITUDE:
            self.guided.attitude.take()
        elif mode is Mode.FLIP:
            self._before_flip = before
            left = pilot.sticks is not None and pilot.sticks.right < 0.0
            Flip(self.guided.attitude, pilot.parameters, -1.0 if left else 1.0)
        elif mode is Mode.FOLLOW:
            self._follow.begin()
        elif mode is Mode.CIRCLE and pilot.landed is not LandedState.ON_GROUND:
            self._circle()

    def fly_on(self) -> None:
        """Continue guided flight, following or a flip; after CIRCLE, stop pointing the nose inward."""
        pilot, attitude = self._pilot, self.guided.attitude
        ended = self.guided.setpoints.expired() if pilot.mode is Mode.GUIDED else None
        if ended is not None:
            pilot.turn_to(ended)
        self.guided.auto_yaw.check()
        if pilot.mode is Mode.FOLLOW:
            self._follow.check()
        if self._points_inward and pilot.mode is not Mode.CIRCLE:
            self._points_inward = False
            pilot.executor.flight.look_at(None)
        if not attitude.active:
            return
        if pilot.mode not in (Mode.GUIDED, Mode.ATTITUDE, Mode.FLIP):
            attitude.stop()
            return
        with suppress(RefusedError):  # the vehicle may have landed meanwhile
            if attitude.check() and pilot.mode is Mode.FLIP:
                pilot.modes.change(self._before_flip)

    def stop(self) -> None:
        """Stop flying an attitude."""
        self.guided.attitude.stop()

    def forget(self) -> None:
        """Forget the setpoint that the vehicle flies."""
        self.guided.setpoints.forget()

    def free_heading(self) -> None:
        """Forget the heading of CONDITION_YAW."""
        self.guided.auto_yaw.forget()

    def _circle(self) -> None:
        """Circle about a point ahead, with the nose inward, as ArduCopter's CIRCLE mode does.

        Source: ArduCopter's ``AC_Circle::init`` and ``calc_velocities``.
        """
        pilot = self._pilot
        get, spec, executor = pilot.parameters, pilot.spec, pilot.executor
        radius, rate = _CIRCLE_RADIUS.of(get), _CIRCLE_RATE.of(get)
        options = int(_CIRCLE_OPTIONS.of(get))
        x, y, z = executor.motion.stopping_point()
        yaw = pilot.state.yaw_rad
        if radius <= 0.0:
            pilot.order(lambda: executor.goto(x, y, z, heading=Heading.turning(rate)))
            return
        if rate == 0.0:
            return
        if not options & _BEGINS_AT_CENTER:
            x, y = x + radius * math.sin(yaw), y + radius * math.cos(yaw)
        most = min(spec.cruise_speed_m_s, math.sqrt(0.5 * spec.acceleration_m_s2 * radius))
        speed = min(abs(rate) * radius, most)
        pilot.order(lambda: executor.orbit(x, y, z, math.copysign(radius, rate), speed))
        if not options & _LOOKS_ALONG:
            self._points_inward = True
            executor.flight.look_at((x, y))

    def _orbit(self, command: VehicleCommand) -> None:
        """Handle DO_ORBIT (PX4); defaults: radius 10 m, cruise speed, present position as the centre.

        PX4 takes the altitude to be above sea level, whatever the frame.
        """
        pilot, modes = self._pilot, self.state.mavlink.modes
        radius, speed, nose, _, _, _, altitude = command.params
        if not math.isfinite(nose) or nose == m.ORBIT_YAW_BEHAVIOUR_UNCHANGED:
            nose = _ORBIT_HEADING.of(pilot.parameters)
        headings = {
            m.ORBIT_YAW_BEHAVIOUR_HOLD_INITIAL_HEADING: Heading.fixed(pilot.state.yaw_rad),
            m.ORBIT_YAW_BEHAVIOUR_UNCONTROLLED: KEEP,
            m.ORBIT_YAW_BEHAVIOUR_HOLD_FRONT_TANGENT_TO_CIRCLE: ALONG,
            m.ORBIT_YAW_BEHAVIOUR_RC_CONTROLLED: KEEP,
        }
        heading = headings.get(int(nose), INWARD)
        position = command.position or pilot.frame.to_wgs84(*pilot.state.position_m[:2])
        up = pilot.state.position_m[2]
        if math.isfinite(altitude):
            up = self.state.above_start(altitude, int(m.MAV_FRAME_GLOBAL))
        radius = radius if math.isfinite(radius) and radius else 10.0
        speed = speed if math.isfinite(speed) and speed > 0.0 else pilot.spec.cruise_speed_m_s
        x, y = pilot.frame.from_wgs84(*position)
        pilot.hold_in(modes.after_command)
        pilot.order(lambda: pilot.executor.orbit(x, y, up, radius, speed, heading=heading))
        if modes.orbit is not None:
            self.state.name_mode(modes.orbit)

    def _take_target(self, message: m.MAVLink_follow_target_message, _now_s: float) -> None:
        """Handle FOLLOW_TARGET; a target without a valid position is ignored."""
        pilot = self._pilot
        latitude, longitude = message.lat / 1e7, message.lon / 1e7
        if pilot.mode is not Mode.FOLLOW or not (
            abs(latitude) <= _POLE and abs(longitude) <= _DATE_LINE and math.isfinite(message.alt)
        ):
            return
        east, north = pilot.frame.from_wgs84(latitude, longitude)
        v_north, v_east, v_down = message.vel
        known = math.isfinite(v_north + v_east + v_down)
        velocity = (v_east, v_north, -v_down) if known else None
        self._follow.take((east, north, message.alt - pilot.frame.altitude_m), velocity)

    def _yaw(self, command: VehicleCommand) -> None:
        """Handle CONDITION_YAW (ArduCopter): angle, rate, direction, and a flag for a relative angle."""
        angle, rate, _, relative = command.params[:4]
        if not (0.0 <= angle <= 360.0 and relative in (0.0, 1.0)):
            raise RefusedError(f"Yaw refused: angle {angle:g}, parameter 4 {relative:g}", text="")
        direction = (command.number(3) > 0) - (command.number(3) < 0)
        turn = self.guided.auto_yaw.order
        turn(math.radians(angle), math.radians(rate), direction, relative=relative == 1.0)

    def _change_altitude(self, command: VehicleCommand) -> None:
        """Handle DO_CHANGE_ALTITUDE: fly to an altitude, given in a frame, at the present position."""
        pilot = self._pilot
        altitude, frame = command.params[0], command.number(2)
        if not math.isfinite(altitude) or frame not in (0, 3, 5, 6):
            raise RefusedError("Altitude refused: invalid altitude or frame", denied=True)
        altitude = self.state.above_start(altitude, frame)
        x, y, _ = pilot.executor.motion.stopping_point()
        mode = self.state.mavlink.modes.after_command
        pilot.goto(*pilot.frame.to_wgs84(x, y), altitude, mode=mode, heading=KEEP)

    def _go_around(self, command: VehicleCommand) -> None:
        """Handle DO_GO_AROUND (ArduPlane): abort the landing and climb; 0 is the landing item's height."""
        height = command.params[0]
        self._pilot.go_around(height if math.isfinite(height) and height > 0.0 else None)

    def _standard_mode(self, command: VehicleCommand) -> Result:
        mode = _STANDARD_MODES.get(command.number(1))
        if mode is None:
            return m.MAV_RESULT_UNSUPPORTED
        enter_mode(self.state, mode, self.state.mavlink.modes[mode])
        return None

    def _position_target(self, source: WireState) -> Message | None:
        if self._pilot.mode not in (Mode.GUIDED, Mode.TAKEOFF):
            return None
        target, flown = source.target_leg, self.guided.setpoints.flown
        velocity = (0.0, 0.0, 0.0) if flown is None else flown.velocity_m_s
        moves = flown is not None and not any(map(math.isnan, velocity))
        if target is None and not moves:
            return None
        mask = _ONLY_VELOCITY if target is None else _BOTH if moves else _ONLY_POSITION
        east, north, up = (0.0, 0.0, 0.0) if target is None else target[1]
        v_east, v_north, v_up = velocity if moves else (0.0, 0.0, 0.0)
        numbers = (north, east, -up, v_north, v_east, -v_up, *[0.0] * 5)
        return m.MAVLink_position_target_local_ned_message(
            source.boot_ms, m.MAV_FRAME_LOCAL_NED, mask, *numbers
        )
