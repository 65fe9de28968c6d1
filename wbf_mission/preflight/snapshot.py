"""What a vehicle told of itself when it was asked before a flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from mission.model import GeoPoint

__all__ = ["FirmwareVersion", "Gps", "VehicleSnapshot"]

_KINDS = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}


@dataclass(frozen=True, slots=True)
class FirmwareVersion:
    """The version of an autopilot's firmware.

    Parameters
    ----------
    kind : int
        FIRMWARE_VERSION_TYPE; 255 is an official release.

    Examples
    --------
    >>> str(FirmwareVersion.of(0x010E02FF)), str(FirmwareVersion.of(0x04070000))
    ('1.14.2', '4.7.0 dev')
    """

    major: int
    minor: int
    patch: int
    kind: int

    @classmethod
    def of(cls, number: int) -> FirmwareVersion:
        """Return the version in AUTOPILOT_VERSION.flight_sw_version."""
        return cls(number >> 24 & 255, number >> 16 & 255, number >> 8 & 255, number & 255)

    @property
    def is_official(self) -> bool:
        """Whether it is a release."""
        return self.kind == 255

    def __str__(self) -> str:
        kind = _KINDS.get(self.kind, f"type {self.kind}")
        return f"{self.major}.{self.minor}.{self.patch} {kind}".strip()


@dataclass(frozen=True, slots=True)
class Gps:
    """Satellite navigation.

    Parameters
    ----------
    fix : int
        GPS_FIX_TYPE.
    """

    fix: int
    satellites: int | None = None
    hdop: float | None = None


@dataclass(frozen=True, slots=True)
class VehicleSnapshot:
    """A vehicle as it answered; None for what it did not tell.

    Parameters
    ----------
    system_id, autopilot, vehicle_type : int
        Ids of its heartbeat: MAV_AUTOPILOT, MAV_TYPE.
    parameters : mapping of str to float
        Those that it told, of those that were asked for.
    sensors_present, sensors_enabled, sensors_health : int or None
        Of SYS_STATUS: MAV_SYS_STATUS_SENSOR.
    estimator_flags : int or None
        ESTIMATOR_STATUS_FLAGS, or EKF_STATUS_FLAGS, whose lower bits mean the same.
    position : GeoPoint or None
        Where it stands.
    battery : float or None
        Fraction that is left.
    reasons : tuple of str
        Why it would not arm, in its own words.
    """

    system_id: int
    autopilot: int
    vehicle_type: int
    armed: bool = False
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    version: FirmwareVersion | None = None
    sensors_present: int | None = None
    sensors_enabled: int | None = None
    sensors_health: int | None = None
    gps: Gps | None = None
    estimator_flags: int | None = None
    position: GeoPoint | None = None
    battery: float | None = None
    reasons: tuple[str, ...] = ()
