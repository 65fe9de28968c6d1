"""Guided flight, follow me, CIRCLE, FLIP, orbits and further commands, as an extra of the vehicle.

Sources of setpoints: MAVLink common.xml (SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT),
ArduPilot "Copter commands in guided mode", ``GCS_Common.cpp`` and ``GCS_MAVLink_Copter.cpp``, PX4 "Offboard
mode" and ``mavlink_receiver.cpp``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeAlias, get_args

from geo.frame import angles_of
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.model import Command
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.parameters import Setting
from sim_vehicle.execution.state import LandedState
from sim_vehicle.mavlink.commands import enter_mode
from sim_vehicle.mavlink.extras import VehicleExtra
from sim_vehicle.motion.legs import ALONG, INWARD, KEEP, Heading, Position
from sim_vehicle.motion.model import attitude_of
from sim_vehicle.pilot.controls import RefusedError
from wbf_mission.addons.modes.follow import FollowPilot
from wbf_mission.addons.modes.guided import AttitudeTarget, Flip, GuidedFlight, Setpoint

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.mavlink.vehicle_command import Result, VehicleCommand
    from sim_vehicle.mavlink.wire_state import WireState

PositionTarget: TypeAlias = (
    m.MAVLink_set_position_target_local_ned_message | m.MAVLink_set_position_target_global_int_message
)
SetpointMessage: TypeAlias = PositionTarget | m.MAVLink_set_attitude_target_message
_GUIDED_OPTIONS, _THRUST_AS_THRUST = Setting("GUID_OPTIONS", 0.0), 8
_IGNORE_POSITION, _IGNORE_FORCE, _FORCE, _IGNORE_YAW, _IGNORE_TURN = 7, 448, 512, 1024, 2048
_IGNORE_RATES, _IGNORE_THRUST, _IGNORE_ATTITUDE = 7, 64, 128
_IGNORE_MOTION = 63
# Lower limit of the hover thrust; MPC_THR_HOVER and MOT_THST_HOVER have minima of 0.1 and 0.125.
_LEAST_HOVER = 0.1
# Minimum lift (m/s^2), which keeps a vehicle steerable; maximum thrust, in units of the hover thrust.
_LEAST_LIFT, _MOST_THRUST = 1.0, 2.0
# Tolerance of a unit quaternion's squared length.
_UNIT = 2e-3
_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET, _BODY_FRD = 1, 7, 8, 9, 12
_GLOBAL = frozenset({0, 3, 5, 6})


def _attitude_of(
    message: m.MAVLink_set_attitude_target_message, spec: VehicleSpec, hover: float, *, climbs: bool
) -> AttitudeTarget | None:
    """Return the target of SET_ATTITUDE_TARGET as ArduCopter reads it; None stops the vehicle.

    If `climbs`, thrust 1 means the climb speed, 0 the descent speed. If not, thrust `hover` holds the height.
    """
    mask = int(message.type_mask)
    rates = [message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate]
    ignored = mask & _IGNORE_RATES
    if mask & _IGNORE_THRUST or ignored not in (0, _IGNORE_RATES) or not math.isfinite(message.thrust):
        return None
    roll = pitch = math.nan
    heading = KEEP
    if not mask & _IGNORE_ATTITUDE:
        w, x, y, z = message.q
        if not abs(w * w + x * x + y * y + z * z - 1.0) < _UNIT:
            return None
        roll, pitch, yaw = angles_of(message.q)
        heading = Heading.fixed(yaw)
    elif ignored or not all(map(math.isfinite, rates)):
        return None
    if not ignored and math.isfinite(rates[2]) and (rates[2] or math.isnan(roll)):
        heading = Heading.turning(rates[2])
    thrust = min(max(message.thrust, 0.0), 1.0)
    share = 2.0 * thrust - 1.0
    climb = share * (spec.climb_speed_m_s if share > 0.0 else spec.descent_speed_m_s)
    return AttitudeTarget(
        roll,
        pitch,
        heading,
        climb if climbs else math.nan,
        (rates[0], rates[1]),
        thrust / max(hover, _LEAST_HOVER),
    )


def _attitude_for(acceleration: Position, heading: float, turn: float, yaw: float) -> AttitudeTarget:
    """Return attitude and thrust for an acceleration (east, north, up); NaN components count as 0."""
    east, north, up = (0.0 if math.isnan(part) else part for part in acceleration)
    up = max(up, _LEAST_LIFT - GRAVITY_M_S2) + GRAVITY_M_S2
    roll, pitch = attitude_of(east, north, up, yaw if math.isnan(heading) else heading)
    nose = KEEP if math.isnan(heading) else Heading.fixed(heading)
    if math.isfinite(turn):
        nose = Heading.turning(turn)
    thrust = min(math.hypot(east, north, up) / GRAVITY_M_S2, _MOST_THRUST)
    return AttitudeTarget(roll, pitch, nose, math.nan, thrust=thrust)


def _enu(north: float, east: float, down: float, yaw: float) -> Position:
    """Convert north-east-down, or forward-right-down at heading `yaw`, to east-north-up."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return north * sin + east * cos, north * cos - east * sin, -down


def _masked(vector: Position, mask: int) -> Position:
    """Return the vector with NaN for ignored components; mask bits 0, 1, 2 are north, east, down."""
    hidden = bool(mask & 3) or math.isnan(vector[0] + vector[1])
    flat = (math.nan, math.nan) if hidden else vector[:2]
    return *flat, math.nan if mask & 4 else vector[2]


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
        handlers: dict[int, Callable[[Any, float], None]] = {
            kind.id: self._take_setpoint for kind in get_args(SetpointMessage)
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
        """In a mode that needs a stream of setpoints, begin to fly the latest setpoint."""
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

    def _take_setpoint(self, message: SetpointMessage, _now_s: float) -> None:
        """Handle SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT or SET_ATTITUDE_TARGET."""
        pilot = self._pilot
        if is_a(message, m.MAVLink_set_attitude_target_message):
            mavlink = self.state.mavlink
            if mavlink.hover_thrust is None:
                pilot.complain("Setpoint refused: no attitude control")
                return
            climbs = mavlink.thrust_climbs
            climbs &= not int(_GUIDED_OPTIONS.of(pilot.parameters)) & _THRUST_AS_THRUST
            hover = mavlink.hover_thrust.of(pilot.parameters)
            with suppress(RefusedError):
                self.guided.take_attitude(_attitude_of(message, pilot.spec, hover, climbs=climbs))
        elif self.guided.setpoints.listens_in(pilot.mode):
            try:
                setpoint = self._setpoint_of(message)
                if isinstance(setpoint, AttitudeTarget):
                    self.guided.take_attitude(setpoint)
                else:
                    self.guided.take_setpoint(setpoint)
            except RefusedError as refusal:
                pilot.complain(str(refusal))

    def _setpoint_of(self, message: PositionTarget) -> Setpoint | AttitudeTarget:
        """Return a message's setpoint; raise RefusedError for an unsupported frame, a force, or no values."""
        kind, mask = int(message.coordinate_frame), int(message.type_mask)
        if mask & _FORCE and mask & _IGNORE_FORCE != _IGNORE_FORCE:
            raise RefusedError("Setpoint refused: forces are not flown", denied=True)
        by_acceleration = mask & _IGNORE_MOTION == _IGNORE_MOTION and mask & _IGNORE_FORCE != _IGNORE_FORCE
        numbers = [message.vx, message.vy, message.vz, message.afx, message.afy, message.afz]
        numbers += (
            [message.x, message.y, message.z]
            if is_a(message, m.MAVLink_set_position_target_local_ned_message)
            else [message.alt]
        )
        if any(map(math.isinf, numbers)):
            raise RefusedError("Setpoint refused: infinite values", denied=True)
        state, frame = self._pilot.state, self._pilot.frame
        x, y, z, yaw = *state.position_m, state.yaw_rad
        turned = kind in (_BODY, _BODY_OFFSET, _BODY_FRD)
        velocity = _enu(message.vx, message.vy, message.vz, yaw if turned else 0.0)
        if not is_a(message, m.MAVLink_set_position_target_local_ned_message):
            if kind not in _GLOBAL:
                raise RefusedError(f"Setpoint refused: frame {kind}", denied=True)
            x_m, y_m = frame.from_wgs84(message.lat_int / 1e7, message.lon_int / 1e7)
            position = (x_m, y_m, self.state.above_start(message.alt, kind))
        elif kind in (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET, _BODY_FRD):
            asked = mask & _IGNORE_POSITION != _IGNORE_POSITION
            # Only ArduPilot accepts positions as offsets from the vehicle.
            if kind != _LOCAL and asked and self._pilot.rules.needs_stream:
                raise RefusedError(f"Setpoint refused: no positions in frame {kind}", denied=True)
            position = _enu(message.x, message.y, message.z, yaw if turned else 0.0)
            if kind != _LOCAL:
                position = (x + position[0], y + position[1], z + position[2])
        else:
            raise RefusedError(f"Setpoint refused: frame {kind}", denied=True)
        heading = message.yaw + (yaw if turned else 0.0)
        if mask & _IGNORE_YAW or not math.isfinite(heading):
            heading = math.nan
        turn = math.nan if mask & _IGNORE_TURN else float(message.yaw_rate)
        if by_acceleration and self.state.mavlink.hover_thrust is not None:
            east, north, up = _enu(message.afx, message.afy, message.afz, yaw if turned else 0.0)
            return _attitude_for((east, north, up), heading, turn, yaw)
        setpoint = Setpoint(_masked(position, mask), _masked(velocity, mask >> 3), heading, turn)
        if all(map(math.isnan, (*setpoint.position_m, *setpoint.velocity_m_s, heading, turn))):
            raise RefusedError("Setpoint refused: neither position nor velocity", denied=True)
        return setpoint

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
        """Handle DO_GO_AROUND (ArduPlane): abort the landing and climb; 0 means the landing item's height."""
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
