"""State for telemetry besides the state of the pilot: clocks, estimated position, plan ids."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

from geo.frame import Quaternion, quaternion_of
from mission.model import RELATIVE_FRAMES, Frame, GeoPoint
from sim_vehicle.airframe.navigation_errors import NavigationErrors, Sensed, SensorNoise
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.execution.state import FlightPhase

if TYPE_CHECKING:
    from sim_vehicle.autopilot.behaviour import BootStage
    from sim_vehicle.pilot.pilot import Pilot

Vector: TypeAlias = tuple[float, float, float]

UNUSED = 65535
"""Value of a 16-bit field for "unknown"."""
# Modes in which the vehicle has no target.
_MANUAL_MODES = frozenset({Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.HOLD})


def int16(value: float) -> int:
    """Return a number rounded and clipped to a 16-bit integer."""
    return max(-32767, min(32767, round(value)))


def int16_vector(vector: Vector, scale: float, unit: float = 1.0) -> tuple[int, int, int]:
    """Return a vector as 16-bit integers in units of ``unit / scale``."""
    x, y, z = vector
    return int16(scale * x / unit), int16(scale * y / unit), int16(scale * z / unit)


def centidegrees(angle_rad: float) -> int:
    """Return a direction in hundredths of a degree, 0 to 35,999."""
    return round(math.degrees(angle_rad) * 100.0) % 36000


def _e7(latitude_deg: float, longitude_deg: float, altitude_m: float) -> tuple[int, int, int]:
    return round(latitude_deg * 1e7), round(longitude_deg * 1e7), round(altitude_m * 1e3)


class WireState:
    """State of a vehicle that its telemetry needs in addition to the pilot's state."""

    def __init__(
        self,
        pilot: Pilot,
        home: GeoPoint,
        *,
        system_id: int,
        epoch_unix_s: float,
        noise: SensorNoise | None = None,
    ) -> None:
        self.pilot = pilot
        self.firmware = pilot.firmware
        self.mavlink = pilot.firmware.mavlink
        self.home = home
        self.system_id = system_id
        self.capabilities = self.mavlink.identity.capabilities
        self.errors = NavigationErrors(noise) if noise is not None and not noise.is_off else None
        # True position, and position as the sensors measure it.
        self.sensed = Sensed.exact((0.0, 0.0, 0.0))
        # Home, and estimated position: latitude and longitude (1e-7 degree), altitude above sea level (mm).
        self.home_e7 = _e7(home.latitude_deg, home.longitude_deg, home.altitude_m)
        self.position_e7 = self.home_e7
        # Estimated velocity: east, north, up.
        self.velocity_m_s = (0.0, 0.0, 0.0)
        # Opaque ids of mission, fence and rally points.
        self.plan_ids = (0, 0, 0)
        # Boot stage; None once the vehicle is up.
        self.boot: BootStage | None = None
        # Clocks: host time, time since boot, and Unix time.
        self.now_us = 0
        self.boot_ms = 0
        self.epoch_unix_s = epoch_unix_s
        self.unix_us = round(epoch_unix_s * 1e6)
        self._epoch_us = self.unix_us
        self._boot_us = 0
        self._no_item_until_us = 0
        self._requested_mode: tuple[Mode, int] | None = None
        pilot.arming.custom_mode = lambda: self.custom_mode

    def name_mode(self, number: int) -> None:
        """Record the requested mode number for heartbeats; BRAKE and LOITER, for example, are one `Mode`."""
        self._requested_mode = (self.pilot.mode, number)

    @property
    def custom_mode(self) -> int:
        """Custom mode number for heartbeats."""
        mode = self.pilot.mode
        if self._requested_mode is not None and self._requested_mode[0] is not mode:
            self._requested_mode = None
        modes = self.mavlink.modes
        if mode is Mode.HOLD and self.pilot.modes.by_itself and modes.own_hold is not None:
            return modes.own_hold
        return modes[mode] if self._requested_mode is None else self._requested_mode[1]

    def forget_item(self, until_s: float) -> None:
        """Report no current item in MISSION_CURRENT before the time `until_s`."""
        self._no_item_until_us = round(until_s * 1e6)

    @property
    def item_known(self) -> bool:
        """Whether MISSION_CURRENT reports the current item."""
        return self.now_us >= self._no_item_until_us

    @property
    def ned_m(self) -> Vector:
        """Estimated position relative to the start: north, east, down."""
        east, north, up = self.sensed.believed_m
        return north, east, -up

    @property
    def ned_m_s(self) -> Vector:
        """Estimated velocity to the north, east and down."""
        east, north, up = self.velocity_m_s
        return north, east, -up

    @property
    def altitude_m(self) -> float:
        """Estimated altitude above sea level."""
        return self.position_e7[2] / 1000.0

    @property
    def angles_rad(self) -> Vector:
        """Roll, pitch and yaw; the yaw is from -pi to pi."""
        state = self.pilot.state
        return state.roll_rad, state.pitch_rad, math.remainder(state.yaw_rad, 2.0 * math.pi)

    @property
    def quaternion(self) -> Quaternion:
        """Attitude quaternion: w, x, y, z."""
        state = self.pilot.state
        return quaternion_of(state.roll_rad, state.pitch_rad, state.yaw_rad)

    @property
    def turning_rad_s(self) -> Vector:
        """Roll, pitch and yaw rates; the roll and pitch rates are 0, because they are not simulated."""
        return 0.0, 0.0, self.pilot.state.yaw_rate_rad_s

    @property
    def force_m_s2(self) -> Vector:
        """Specific force on the accelerometers: forward, right, down."""
        east, north, up = self.pilot.state.acceleration_m_s2
        return self.to_body(north, east, -(up + GRAVITY_M_S2))

    def to_body(self, north: float, east: float, down: float) -> Vector:
        """Rotate a vector from (north, east, down) to (forward, right, down): by yaw, pitch, then roll."""
        state = self.pilot.state
        cy, sy = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
        cp, sp = math.cos(state.pitch_rad), math.sin(state.pitch_rad)
        cr, sr = math.cos(state.roll_rad), math.sin(state.roll_rad)
        x, y = cy * north + sy * east, cy * east - sy * north
        x, z = cp * x - sp * down, sp * x + cp * down
        return x, cr * y + sr * z, cr * z - sr * y

    @property
    def target_leg(self) -> tuple[Vector, Vector] | None:
        """Start and end of the present leg; None without a leg and in modes without a target."""
        pilot = self.pilot
        executor = pilot.executor
        plan = executor.flight.plan
        if plan is None or pilot.mode in _MANUAL_MODES or executor.flight.phase is FlightPhase.STEERED:
            return None
        leg = min(executor.motion.leg, len(plan.legs) - 1)
        return plan.legs[leg - 1].end_m if leg else executor.flight.began_m, plan.legs[leg].end_m

    def set_time(self, now_us: int) -> None:
        """Set the clocks."""
        self.now_us = now_us
        self.boot_ms = (now_us - self._boot_us) // 1000 & 0xFFFFFFFF
        self.unix_us = self._epoch_us + now_us

    def sense(self, now_s: float) -> None:
        """Update the positions and the velocity that the sensors give."""
        position = self.pilot.state.position_m
        self.sensed = Sensed.exact(position) if self.errors is None else self.errors.sense(position, now_s)
        self.velocity_m_s = self.pilot.state.velocity_m_s
        error_m, error_east, error_north, error_up = self.pilot.executor.motion.estimate_error
        if error_m != 0.0:
            east, north, up = self.sensed.believed_m
            self.sensed = Sensed((east, north, up + error_m), *self.sensed[1:])
            east, north, up = self.velocity_m_s
            self.velocity_m_s = (east + error_east, north + error_north, up + error_up)
        self.position_e7 = self.e7_of(self.sensed.believed_m)
        if self.boot is not None and not self.boot.tells_place:
            self.position_e7 = (0, 0, self.position_e7[2])

    def above_start(self, altitude_m: float, frame: int) -> float:
        """Convert an altitude in a MAV_FRAME to a height above the start, which is as high as the terrain."""
        if frame in (Frame.GLOBAL_TERRAIN_ALT, Frame.GLOBAL_TERRAIN_ALT_INT):
            return altitude_m
        return altitude_m + (self.pilot.home_m[2] if frame in RELATIVE_FRAMES else -self.home.altitude_m)

    def e7_of(self, position_m: Vector) -> tuple[int, int, int]:
        """Return a local position as degrees * 1e7 and millimetres above sea level."""
        east, north, up = position_m
        return _e7(*self.pilot.frame.to_wgs84(east, north), up + self.home.altitude_m)

    def move_home(self) -> GeoPoint:
        """Take over the pilot's home, and return the new position of home."""
        east, north, up = self.pilot.home_m
        latitude, longitude = self.pilot.frame.to_wgs84(east, north)
        self.home_e7 = _e7(latitude, longitude, self.home.altitude_m + up)
        return GeoPoint(latitude, longitude, self.home.altitude_m + up)

    def reboot(self) -> None:
        """Restart the time since boot and clear the plan ids."""
        self._boot_us = self.now_us
        self.boot_ms = 0
        self.plan_ids = (0, 0, 0)

    def wire_seq(self, seq: int) -> int:
        """Return the number of a mission item in MAVLink messages; ArduPilot counts home as item 0."""
        return seq + self.firmware.profile.home_at_zero

    def own_seq(self, seq: int) -> int:
        """Return the item index of a number in MAVLink messages; home's number gives the first item."""
        return max(0, seq - 1) if self.firmware.profile.home_at_zero else seq

    def position_error(self, boot_us: float) -> tuple[float, float]:
        """Return the error of the estimated position (east, north) at a time since boot."""
        if self.errors is None:
            return 0.0, 0.0
        error = self.errors.at((boot_us + self._boot_us) / 1e6)
        return error.east_m, error.north_m
