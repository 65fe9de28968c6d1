"""What PX4's simulator streams on each of its links, of the messages that the simulated vehicle makes.

Sources: ``px4-rc.mavlink`` (links, ports, data rates, raised rates), ``mavlink_main.cpp``
(``configure_streams_to_default``, ``update_rate_mult``), ``mavlink_mission.cpp`` (MISSION_CURRENT),
``SensorGpsSim.cpp`` (8 Hz, where the stream has no limit).
"""

from __future__ import annotations

from collections.abc import Mapping

from mission.link.codec.dialect import mavlink as m

__all__ = ["LIGHT_LINKS", "LINK_NAMES", "SITL_LINKS", "simulator_urls"]

LINK_NAMES = ("ground", "api", "payload", "gimbal")
"""Names of the links of `simulator_urls`, in that order."""
_LAST_API_INSTANCE = 9
_PAYLOAD_BYTES_S = 4000.0
_LEAST_SHARE = 0.05
_OVERHEAD = 12
# In Hz: on the ground link (mode normal, and what the start script raises), in modes onboard and gimbal; 0 is
# not streamed.
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
# Not scaled with a link's data rate: constant, or as often as the receiver has a position.
_UNSCALED = frozenset(
    {m.MAVLINK_MSG_ID_HEARTBEAT, m.MAVLINK_MSG_ID_MISSION_CURRENT, m.MAVLINK_MSG_ID_GPS_RAW_INT}
)


def _rates_hz(column: int) -> Mapping[int, float]:
    rows = [line.split() for line in _STREAMS.strip().splitlines()]
    rates = {int(getattr(m, f"MAVLINK_MSG_ID_{row[0]}")): float(row[column]) for row in rows}
    return {message_id: rate for message_id, rate in rates.items() if rate > 0.0}


def _within(bytes_s: float, rates_hz: Mapping[int, float]) -> Mapping[int, float]:
    """Return the rates that a link of this data rate carries, as ``update_rate_mult`` scales them."""

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
"""Link to message rates as PX4's simulator has them; "" is the API link, and any further one."""
LIGHT_LINKS: Mapping[str, Mapping[int, float]] = {"payload": _ALIVE, "gimbal": _ALIVE}
"""Link to message rates where they are not the vehicle's usual ones."""


def simulator_urls(index: int) -> tuple[str, ...]:
    """Ports of SITL for a ground station, an API, a payload (camera) and a gimbal."""
    api = min(index, _LAST_API_INSTANCE)
    ports = (
        (14550, 18570 + index),
        (14540 + api, 14580 + index),
        (14030 + index, 14280 + index),
        (13280 + index, 13030 + index),
    )
    return tuple(f"udpout:127.0.0.1:{remote},{local}" for remote, local in ports)
