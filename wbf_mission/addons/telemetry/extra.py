"""Further telemetry as an extra of the simulated vehicle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.mavlink.extras import VehicleExtra
from sim_vehicle.mavlink.wire_state import int16_vector
from wbf_mission.addons.telemetry.ardupilot import ARDUPILOT_BUILDERS
from wbf_mission.addons.telemetry.sensors import BUILDERS

if TYPE_CHECKING:
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.mavlink.wire_state import Vector, WireState

__all__ = ["TelemetryExtra"]

_GAUSS = (0.25, 0.0, 0.41)
_CENTIDEGREES = 2500
# Longest interval over which roll and pitch rates are averaged.
_LONGEST_MEAN_S = 1.5


class TelemetryExtra(VehicleExtra):
    """Telemetry that ground stations show."""

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        super().__init__(state, parameters, plans)
        self._pings = 0
        self._attitude: Vector = (-math.inf, 0.0, 0.0)
        self._rates = (0.0, 0.0, 0.0)
        self.builders = {
            **BUILDERS,
            **ARDUPILOT_BUILDERS,
            m.MAVLINK_MSG_ID_PING: self._ping,
            m.MAVLINK_MSG_ID_RAW_IMU: lambda s: m.MAVLink_raw_imu_message(
                s.boot_ms * 1000, *self._readings(s, 0, _CENTIDEGREES)
            ),
            m.MAVLINK_MSG_ID_SCALED_IMU2: lambda s: m.MAVLink_scaled_imu2_message(
                s.boot_ms, *self._readings(s, _CENTIDEGREES)
            ),
        }

    def _ping(self, source: WireState) -> Message:
        """PING with the vehicle's own sequence number, from 0."""
        self._pings += 1
        return m.MAVLink_ping_message(source.unix_us, self._pings - 1, 0, 0)

    def _readings(self, source: WireState, *further: int) -> list[int]:
        """Return accelerometer (1e-3 g), gyroscope (mrad/s) and compass (mgauss) as forward, right, down."""
        return [
            *int16_vector(source.force_m_s2, 1000.0, GRAVITY_M_S2),
            *int16_vector(self._body_rates(), 1000.0),
            *int16_vector(source.to_body(*_GAUSS), 1000.0),
            *further,
        ]

    def _body_rates(self) -> Vector:
        """Return the body rates (forward, right, down; rad/s), averaged since the previous call."""
        state, (time_s, roll, pitch) = self.state.pilot.state, self._attitude
        passed_s = state.time_s - time_s
        if passed_s > 0.0:
            rolling, pitching = 0.0, 0.0
            if passed_s < _LONGEST_MEAN_S:
                rolling = math.remainder(state.roll_rad - roll, 2.0 * math.pi) / passed_s
                pitching = (state.pitch_rad - pitch) / passed_s
            sr, cr = math.sin(state.roll_rad), math.cos(state.roll_rad)
            sp, cp = math.sin(state.pitch_rad), math.cos(state.pitch_rad)
            yawing = state.yaw_rate_rad_s
            self._attitude = (state.time_s, state.roll_rad, state.pitch_rad)
            self._rates = (
                rolling - yawing * sp,
                pitching * cr + yawing * sr * cp,
                yawing * cr * cp - pitching * sr,
            )
        return self._rates
