"""Flies mission items and direct targets over a motion model. Pure: no MAVLink, no clock of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_vehicle.flight import FlightEvent, Phase, VehicleState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from geo.frame import LocalFrame
    from mission.model import MissionItem
    from sim_vehicle.spec import VehicleSpec
    from sim_vehicle.wind import Wind


class MissionExecutor:
    """One vehicle in flight.

    Parameters
    ----------
    spec : VehicleSpec
    frame : LocalFrame
        About home: origin (0, 0) is home, ``altitude_m`` the height of the ground there above sea level.
    wind : Wind, optional
    yaw_rad : float
        Compass heading at the start.

    Use: ``load(items)``, ``arm()``, ``start()``, then ``advance(until_s)`` again and again.
    """

    armed: bool
    phase: Phase
    current_seq: int
    time_s: float
    items: tuple[MissionItem, ...]

    def __init__(
        self, spec: VehicleSpec, frame: LocalFrame, *, wind: Wind | None = None, yaw_rad: float = 0.0
    ) -> None: ...

    def load(self, items: Sequence[MissionItem]) -> None:
        """Replace the mission (current item 0); in flight on a mission: the vehicle holds."""

    def arm(self) -> None:
        """Start the motors (no effect when armed). VehicleError when the battery is empty."""

    def disarm(self, *, force: bool = False) -> None:
        """Stop the motors. VehicleError in the air, unless forced: then the vehicle drops."""

    def start(self) -> None:
        """Begin or resume the mission at the current item. VehicleError if not armed or nothing loaded."""

    def set_current(self, seq: int) -> None:
        """Make an item the current one, at once if the mission is being flown. VehicleError out of range."""

    def takeoff(self, altitude_m: float) -> None:
        """Climb to an altitude above home and hold."""

    def hold(self) -> None:
        """Stop and stay (pauses a mission: `start` resumes it)."""

    def goto(
        self, x_m: float, y_m: float, altitude_m: float, *, yaw_rad: float | None = None, speed_m_s: float | None = None
    ) -> None:
        """Fly to a place about home and hold there."""

    def return_home(self) -> None:
        """Climb to the return altitude, fly home, land."""

    def land(self) -> None:
        """Land here."""

    def set_speed(self, speed_m_s: float) -> None:
        """Set the ground speed until the mission sets another."""

    def advance(self, until_s: float) -> list[FlightEvent]:
        """Fly until a time; events in order, each with its own time."""

    def state(self) -> VehicleState:
        """Return the state now."""


def check_mission(items: Sequence[MissionItem], frame: LocalFrame, spec: VehicleSpec) -> list[str]:
    """List what the vehicle could not fly, each with its item; empty when all is well."""
