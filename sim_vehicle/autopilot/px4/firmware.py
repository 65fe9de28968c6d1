"""MAVLink profile, streams, parameters, behaviour and stick rules of PX4.

Sources: PX4 v1.17 ``px4_custom_mode.h``, ``mavlink_main.cpp`` (rates), ``Commander.cpp`` and ``ModeUtil``
(texts), ``mission_base.cpp``, ``mission.cpp``, ``mavlink_mission.cpp``, the parameter reference, and recorded
flights of PX4 1.17 (SIH). Sources of the streams of the simulator's links: ``px4-rc.mavlink`` (links, ports,
data rates, raised rates), ``mavlink_main.cpp`` (``configure_streams_to_default``, ``update_rate_mult``),
``mavlink_mission.cpp`` (MISSION_CURRENT), ``SensorGpsSim.cpp`` (8 Hz for a stream without limit).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from sim_vehicle.autopilot.behaviour import (
    Action,
    FailsafeRules,
    IdleDisarm,
    MissionBehaviour,
    Mode,
    ModeTable,
    actions_by_value,
    px4_custom_mode,
)
from sim_vehicle.autopilot.mavlink_profile import (
    COMMON_CAPABILITIES,
    Identity,
    LogBehaviour,
    MavlinkProfile,
    RefusalTexts,
)
from sim_vehicle.autopilot.parameters import MavParameter, Setting
from sim_vehicle.autopilot.stick_rules import Axis, StickLoss, StickRules, TiltSticks, bits

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mission.model import MissionItem
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.parameters import RuntimeParameters

# SIH_KDV / SIH_MASS of the reference airframe (SIH 10040).
_SIH_DRAG_1_S = 1.0
LINK_NAMES = ("ground", "api", "payload", "gimbal")
"""Names of the links of `simulator_urls`, in the same order."""
_LAST_API_INSTANCE = 9
_PAYLOAD_BYTES_S = 4000.0
_LEAST_SHARE = 0.05
_OVERHEAD = 12
# Message rates (Hz) of three link modes: normal (ground link, raised by the start script), onboard, gimbal.
_STREAMS = """
    ALTITUDE                             1   10   0
    ATTITUDE                            50  100   0
    ATTITUDE_QUATERNION                 50   50   0
    AUTOPILOT_STATE_FOR_GIMBAL_DEVICE    0    0  20
    BATTERY_STATUS                     0.5  0.5   0
    CURRENT_MODE                       0.5  0.5   0
    ESTIMATOR_STATUS                   0.5    1   0
    EXTENDED_SYS_STATE                   1    5   0
    GLOBAL_POSITION_INT                 50   50   0
    GPS_GLOBAL_ORIGIN                    1    1   0
    GPS_RAW_INT                          5    8   0
    HEARTBEAT                            1    1   1
    HIGHRES_IMU                          0   50   0
    HOME_POSITION                      0.5  0.5   0
    LOCAL_POSITION_NED                  50   30   0
    MISSION_CURRENT                      1    1   1
    ODOMETRY                             0   30   0
    PING                               0.1    1   0
    POSITION_TARGET_GLOBAL_INT           1   10   0
    POSITION_TARGET_LOCAL_NED           50   10   0
    SCALED_PRESSURE                      1    1   0
    SERVO_OUTPUT_RAW                    50   10   0
    SYSTEM_TIME                          0    1   0
    SYS_STATUS                           1    5   0
    TIMESYNC                             0   10   0
    VFR_HUD                              4   10   0
    VIBRATION                          0.1  0.5   0
    WIND_COV                           0.5   10   0
"""
# Streams that do not scale with the data rate of a link. GPS_RAW_INT has the rate of the receiver.
_UNSCALED = frozenset(
    {m.MAVLINK_MSG_ID_HEARTBEAT, m.MAVLINK_MSG_ID_MISSION_CURRENT, m.MAVLINK_MSG_ID_GPS_RAW_INT}
)


def _rates_hz(column: int) -> Mapping[int, float]:
    rows = [line.split() for line in _STREAMS.strip().splitlines()]
    rates = {int(getattr(m, f"MAVLINK_MSG_ID_{row[0]}")): float(row[column]) for row in rows}
    return {message_id: rate for message_id, rate in rates.items() if rate > 0.0}


def _within(bytes_s: float, rates_hz: Mapping[int, float]) -> Mapping[int, float]:
    """Return message rates scaled down to the data rate of a link, as in PX4's ``update_rate_mult``."""

    def load(message_id: int) -> float:
        size: int = m.mavlink_map[message_id].unpacker.size
        return (size + _OVERHEAD) * rates_hz[message_id]

    scaled = rates_hz.keys() - _UNSCALED
    left = bytes_s - load(m.MAVLINK_MSG_ID_HEARTBEAT)
    share = min(max(left / sum(map(load, scaled)), _LEAST_SHARE), 1.0)
    return {kind: rate * share if kind in scaled else rate for kind, rate in rates_hz.items()}


_GROUND, _ONBOARD, _GIMBAL = map(_rates_hz, (1, 2, 3))
_ALIVE = {int(m.MAVLINK_MSG_ID_HEARTBEAT): 1.0}
SITL_LINKS: Mapping[str, Mapping[int, float]] = {
    "": _ONBOARD,
    "ground": _GROUND,
    "payload": _within(_PAYLOAD_BYTES_S, _ONBOARD),
    "gimbal": _GIMBAL,
}
"""Message rates of PX4's simulator by link; "" is the API link and every other link."""
LIGHT_LINKS: Mapping[str, Mapping[int, float]] = {"payload": _ALIVE, "gimbal": _ALIVE}
"""Message rates by link, for links that do not have the rates `_RATES_HZ`."""


def simulator_urls(index: int) -> tuple[str, ...]:
    """Return the addresses of SITL for ground station, API, payload (camera) and gimbal."""
    api = min(index, _LAST_API_INSTANCE)
    ports = (
        (14550, 18570 + index),
        (14540 + api, 14580 + index),
        (14030 + index, 14280 + index),
        (13280 + index, 13030 + index),
    )
    return tuple(f"udpout:127.0.0.1:{remote},{local}" for remote, local in ports)


_RATES_HZ = {
    m.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    m.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    m.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 5.0,
    m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 5.0,
    m.MAVLINK_MSG_ID_VFR_HUD: 5.0,
    m.MAVLINK_MSG_ID_ALTITUDE: 1.0,
    m.MAVLINK_MSG_ID_HIGHRES_IMU: 1.0,
    m.MAVLINK_MSG_ID_ODOMETRY: 1.0,
    m.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
    m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    m.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    m.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    m.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    m.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    m.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
}
_MODES = ModeTable(
    (
        (px4_custom_mode(1), Mode.MANUAL, "Manual"),
        (px4_custom_mode(2), Mode.ALTITUDE, "Altitude"),
        (px4_custom_mode(3), Mode.POSITION, "Position"),
        (px4_custom_mode(4, 2), Mode.TAKEOFF, "Takeoff"),
        (px4_custom_mode(4, 3), Mode.HOLD, "Hold"),
        (px4_custom_mode(4, 4), Mode.MISSION, "Mission"),
        (px4_custom_mode(4, 5), Mode.RTL, "Return"),
        (px4_custom_mode(4, 6), Mode.LAND, "Land"),
        (px4_custom_mode(4, 8), Mode.FOLLOW, "Follow Me"),
        (px4_custom_mode(6), Mode.GUIDED, "Offboard"),
        (px4_custom_mode(4, 1), Mode.HOLD, "Hold"),
        (px4_custom_mode(5), Mode.MANUAL, "Acro"),
        (px4_custom_mode(7), Mode.MANUAL, "Stabilized"),
    ),
    boot=Mode.HOLD,
    after_takeoff=Mode.HOLD,
    after_command=Mode.HOLD,
    orbit=px4_custom_mode(3, 1),
    refused_text="Switching to {name} is currently not available",
    unknown_text="Unsupported auto mode",
    main_and_sub=True,
)
# Only multirotors have the mode Follow Me.
_MODES_OF_OTHERS = replace(_MODES, rows=tuple(row for row in _MODES.rows if row[1] is not Mode.FOLLOW))
_HOVER_THRUST = Setting("MPC_THR_HOVER", 0.6)
# Git hash of v1.17.0 (d6f12ad1c4f70ad3...), lowest byte first like ``px4_firmware_version_binary``.
_GIT_HASH = 0xD6F12AD1C4F70AD3.to_bytes(8, "little")


def mavlink_profile(mav_type: int) -> MavlinkProfile:
    """Return PX4's MAVLink profile for a MAV_TYPE."""
    return MavlinkProfile(
        identity=Identity(
            mav_autopilot=int(m.MAV_AUTOPILOT_PX4),
            mav_type=int(mav_type),
            version=(1, 17, 0),
            custom_version=_GIT_HASH,
            capabilities=COMMON_CAPABILITIES | int(m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE),
        ),
        modes=_MODES if mav_type == m.MAV_TYPE_QUADROTOR else _MODES_OF_OTHERS,
        rates_hz=_RATES_HZ,
        truth_message=int(m.MAVLINK_MSG_ID_HIL_STATE_QUATERNION),
        link_rates_hz=LIGHT_LINKS,
        sitl_rates_hz=SITL_LINKS,
        reached_repeats=10,
        reached_merged=True,
        no_mission_total=65535,
        unsupported=frozenset(
            {
                int(m.MAV_CMD_CONDITION_YAW),
                int(m.MAV_CMD_DO_FENCE_ENABLE),
                int(m.MAV_CMD_DO_GO_AROUND),
                int(m.MAV_CMD_DO_PAUSE_CONTINUE),
                int(m.MAV_CMD_DO_SEND_BANNER),
                int(m.MAV_CMD_DO_SET_MISSION_CURRENT),
                int(m.MAV_CMD_DO_SET_RELAY),
                int(m.MAV_CMD_DO_SET_SERVO),
                int(m.MAV_CMD_DO_START_MAG_CAL),
                int(m.MAV_CMD_DO_ACCEPT_MAG_CAL),
                int(m.MAV_CMD_DO_CANCEL_MAG_CAL),
            }
        ),
        # Commander leaves these commands to modules that PX4 does not start by default.
        silent=frozenset(map(int, (m.MAV_CMD_INJECT_FAILURE, m.MAV_CMD_DO_GRIPPER, m.MAV_CMD_DO_WINCH))),
        home_above_sea=True,
        reposition_turns=True,
        hover_thrust=_HOVER_THRUST if mav_type == m.MAV_TYPE_QUADROTOR else None,
        tells_remaining_time=True,
        component_metadata=("px4", "sim_vehicle.autopilot"),
        reports_calibration=True,
        refusals=RefusalTexts(
            arming="Unsupported ARM_DISARM param: {:.3f}",
            current_item="WPM: WP CURR CMD: Not in list",
            current_item_busy="WPM: IGN WP CURR CMD: Busy",
        ),
        logs=LogBehaviour("/fs/microsd/log", by_date=True),
    )


_SAFETY = (
    MavParameter("BAT_EMERGEN_THR", "emergency_fraction", low=0.0, high=0.3),
    MavParameter("COM_RCL_EXCEPT", "failsafe_options", integer=True, low=0, high=31),
    MavParameter("COM_DL_LOSS_T", "link_timeout_s", integer=True, low=5, high=300),
    MavParameter("COM_OF_LOSS_T", "setpoint_timeout_s", low=0.1, high=60.0),
    MavParameter("GF_ACTION", "fence_action", integer=True, low=0, high=5),
    MavParameter("GF_MAX_HOR_DIST", "fence_radius_m", low=0.0, high=10_000.0),
    MavParameter("GF_MAX_VER_DIST", "fence_ceiling_m", low=0.0, high=10_000.0),
    MavParameter("MIS_TKO_LAND_REQ", "mission_requirement", integer=True, low=0, high=5),
    MavParameter("NAV_DLL_ACT", "link_action", integer=True, low=0, high=6),
)


def copter_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Return the parameters of a multirotor.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> [parameter.name for parameter in copter_parameters(get_vehicle("quad"), 1)][-2:]
    ['MPC_Z_VEL_MAX_DN', 'MPC_Z_VEL_MAX_UP']
    """
    return [
        *common_parameters(spec, system_id, m.MAV_TYPE_QUADROTOR),
        MavParameter("MPC_ACC_HOR", value=spec.acceleration_m_s2),
        MavParameter("MPC_JERK_AUTO", value=spec.jerk_m_s3),
        MavParameter("MPC_LAND_SPEED", "landing_speed_m_s", low=0.1, high=spec.descent_speed_m_s),
        MavParameter("MPC_XY_CRUISE", "cruise_speed_m_s", low=0.1, high=spec.top_speed_m_s),
        MavParameter("MPC_XY_VEL_MAX", value=spec.speed_limit_m_s),
        MavParameter("MPC_Z_VEL_MAX_DN", value=spec.descent_speed_m_s),
        MavParameter("MPC_Z_VEL_MAX_UP", value=spec.climb_speed_m_s),
    ]


def common_parameters(spec: VehicleSpec, system_id: int, mav_type: int) -> list[MavParameter]:
    """Return the parameters common to all vehicles."""
    return [
        *_SAFETY,
        MavParameter("BAT1_N_CELLS", integer=True, value=spec.battery.cells if spec.battery else 0),
        MavParameter("BAT_CRIT_THR", "critical_fraction", low=0.0, high=0.5),
        MavParameter("BAT_LOW_THR", "low_fraction", low=0.0, high=0.9),
        MavParameter("COM_DISARM_LAND", "disarm_delay_s", low=0.0, high=600.0),
        MavParameter("COM_LOW_BAT_ACT", "low_battery_action", integer=True, low=0, high=3),
        MavParameter("CAL_ACC0_ID", integer=True, value=1310988),
        MavParameter("CAL_GYRO0_ID", integer=True, value=1310988),
        MavParameter("CAL_MAG0_ID", integer=True, value=197388),
        MavParameter("COM_RC_IN_MODE", integer=True, value=1),
        MavParameter("MAV_COMP_ID", integer=True, value=1),
        MavParameter("MAV_SYS_ID", integer=True, value=system_id),
        MavParameter("MAV_TYPE", integer=True, value=mav_type),
        MavParameter("MIS_TAKEOFF_ALT", "takeoff_altitude_m", low=0.5, high=spec.max_altitude_m),
        MavParameter("NAV_ACC_RAD", "acceptance_radius_m", low=0.05, high=200.0),
        MavParameter("RTL_RETURN_ALT", "return_altitude_m", low=0.5, high=spec.max_altitude_m),
        MavParameter("SYS_AUTOSTART", integer=True, value=4001),
    ]


_TAKEOFFS = frozenset({int(Command.NAV_TAKEOFF), 84})
_LANDINGS = frozenset({int(Command.NAV_LAND), 85})
_WANTS_TAKEOFF, _WANTS_LANDING = (1, 3), (2, 3)
_BOTH_OR_NEITHER = (4, 5)


def px4_takeoff_and_landing(items: Sequence[MissionItem], parameters: RuntimeParameters) -> str | None:
    """Return the reason why MIS_TKO_LAND_REQ refuses a mission, or None.

    The value 1 requires a take-off item, 2 a landing item, 3 both, 4 and 5 both or neither. A return item
    does not count as a landing item.
    """
    rule = parameters.mission_requirement
    commands = {int(item.command) for item in items}
    takes_off, lands = bool(commands & _TAKEOFFS), bool(commands & _LANDINGS)
    if rule in _WANTS_TAKEOFF and not takes_off:
        return "Takeoff waypoint required."
    if rule in _WANTS_LANDING and not lands:
        return "Landing waypoint/pattern required."
    if rule in _BOTH_OR_NEITHER and takes_off != lands:
        return "Add Landing item or remove Takeoff." if takes_off else "Add Takeoff item or remove Landing."
    return None


MISSION = MissionBehaviour(
    replays_speed=True,
    rewinds_survey=True,
    return_lag_s=0.3,
    finished_texts=("Mission finished, loitering", "Mission finished, landed"),
    return_text="Returning to launch",
    no_mission_text="No valid mission available, loitering",
    outside_text="Geofence violation for waypoint {}",
    unknown_current_s=0.5,
    refuses=px4_takeoff_and_landing,
)


RULES = FailsafeRules(
    fence_actions=actions_by_value(NONE="0", WARN="1", HOLD="2", RETURN="3", TERMINATE="4", LAND="5"),
    link_actions=actions_by_value(NONE="0", HOLD="1", RETURN="2", LAND="3", TERMINATE="5 6"),
    # PX4 no longer uses the value 1; with it, the simulated vehicle returns home at the low battery level.
    battery_actions=(
        actions_by_value(WARN="0 2 3", RETURN="1"),
        actions_by_value(WARN="0", LAND="1 2", RETURN="3"),
        actions_by_value(WARN="0", LAND="1 2 3"),
    ),
    critical_apart=False,
    watches_voltage=False,
    any_inclusion=True,
    needs_stream=True,
    pauses_in_mode=False,
    yaws_to_setpoint=False,
    fences_setpoints=False,
    tells_link_loss=True,
    preflight="Preflight Fail",
    arming_texts=("Preflight Fail: {}", "Arming denied: Resolve system health failures first"),
    fence_text="Geofence violated: {}",
    fence_clear="Geofence violation cleared",
    link_lost="Data link lost",
    link_regained="Data link regained",
    stream_lost="Offboard control lost: {}",
    idle=IdleDisarm(
        Setting("COM_DISARM_PRFLT", 10.0), ("Disarmed by auto preflight disarming",), first_flight=True
    ),
    any_mode_disarmed=True,
    restores_mode=True,
    fence_refusal="Reposition is outside geofence",
    armed_by_start="Armed by mission start",
)


_DEGREE = math.radians(1.0)
_ACRO = px4_custom_mode(5)
AXIS = Axis(0.1, 0.6)
LOSS = StickLoss(
    timeout=Setting("COM_RC_LOSS_T", 0.5),
    action=Setting("NAV_RCL_ACT", 2.0),
    actions=actions_by_value(NONE="0", HOLD="1", RETURN="2", LAND="3", TERMINATE="5", DISARM="6"),
    exceptions=bits(MISSION=1, HOLD=2, TAKEOFF=2, LAND=2, RTL=2, GUIDED=4),
    in_stick_modes=Action.RETURN,
    delay=Setting("COM_FAIL_ACT_T", 5.0),
    lost="Failsafe activated",
    delayed="Failsafe activated: entering Hold for {:.0f} seconds",
)


def drag_of(spec: VehicleSpec) -> float:
    """Return the drag divided by mass and airspeed (1/s); the default is for the reference airframe."""
    return _SIH_DRAG_1_S if spec.linear_drag_1_s is None else spec.linear_drag_1_s


COPTER_STICKS = StickRules(
    speeds={Mode.POSITION: Setting("MPC_VEL_MANUAL", 10.0), Mode.ALTITUDE: None, Mode.MANUAL: None},
    needed=frozenset({Mode.POSITION, Mode.ALTITUDE, Mode.MANUAL}),
    level=AXIS,
    vertical=AXIS,
    turning=AXIS,
    turn_rate=Setting("MPC_MAN_Y_MAX", 150.0, _DEGREE),
    # The default 0 stands for the vehicle's vertical speeds.
    climb=Setting("MPC_Z_VEL_MAX_UP", 0.0),
    descent=Setting("MPC_Z_VEL_MAX_DN", 0.0),
    takeoff_stick=0.3,
    tilt=TiltSticks(
        holds_height=frozenset({Mode.ALTITUDE}),
        by_throttle=frozenset({Mode.MANUAL}),
        by_rate=frozenset({_ACRO}),
        lean=Setting("MPC_MAN_TILT_MAX", 35.0, _DEGREE),
        roll_rate=Setting("MC_ACRO_R_MAX", 100.0, _DEGREE),
        pitch_rate=Setting("MC_ACRO_P_MAX", 100.0, _DEGREE),
        yaw_rate=Setting("MC_ACRO_Y_MAX", 100.0, _DEGREE),
        hover_thrust=_HOVER_THRUST,
        least_thrust=Setting("MPC_MANTHR_MIN", 0.08),
        most_thrust=Setting("MPC_THR_MAX", 1.0),
        hold_below=Setting("MPC_HOLD_MAX_Z", 0.6),
        drag=drag_of,
    ),
    loss=LOSS,
)
