"""Vehicle extras: parts that add-ons give to every simulated vehicle, by entry points of `EXTRA_GROUP`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, ClassVar, Protocol, TypeAlias

from geo.imports import entry_points, load_entry
from mission.link.codec.dialect import Message
from sim_vehicle.errors import VehicleError
from sim_vehicle.mavlink.parameters import ParameterSet
from sim_vehicle.mavlink.plan_receiver import PlanReceiver
from sim_vehicle.mavlink.vehicle_command import Result, VehicleCommand
from sim_vehicle.mavlink.wire_state import WireState
from sim_vehicle.pilot.mode_control import PilotExtra

EXTRA_GROUP = "wbf_mission.vehicle_extras"
"""Entry point group; each entry makes a `VehicleExtra` from a vehicle's `WireState`, parameters and plans."""


class Timed(Protocol):
    """Part of a vehicle that sends messages at the time ``due_s``."""

    @property
    def due_s(self) -> float:
        """Time of the next `poll` that has an effect (s); infinite if no `poll` will have an effect."""

    def poll(self, now_s: float) -> Iterable[Message]:
        """Return the messages that are due."""


class VehicleExtra(PilotExtra):
    """Part of a vehicle that an add-on provides; a subclass overrides the methods that it needs.

    Parameters
    ----------
    state : WireState
        Telemetry source of the vehicle, with its pilot.
    parameters : ParameterSet
        Parameters of the vehicle.
    plans : PlanReceiver
        Mission, fence and rally points of the vehicle.
    """

    capabilities: ClassVar[int] = 0
    """Bits added to the capabilities in AUTOPILOT_VERSION (MAV_PROTOCOL_CAPABILITY)."""

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        self.state = state
        self.parameters = parameters
        self.plans = plans
        # Handlers by message id; they get the message and the time, after the vehicle's handler has run.
        self.handlers: Mapping[int, Callable[[Any, float], Iterable[Message] | None]] = {}
        # Handlers by MAV_CMD; a handler of the vehicle for the same command runs last and gives the result.
        self.commands: Mapping[int, Callable[[VehicleCommand], Result]] = {}
        # Telemetry builders by message id; a builder returns None if there is nothing to send.
        self.builders: Mapping[int, Callable[[WireState], Message | None]] = {}
        self.timed: Sequence[Timed] = ()

    def advance(self) -> None:
        """Advance to the vehicle's time."""

    def watch(self) -> None:
        """React to a change of mode, before the vehicle reports the mode."""

    def reboot(self) -> None:
        """Reboot the extra together with the vehicle."""

    def execute(self, command: VehicleCommand) -> None:
        """Execute a mission item for the camera, its gimbal or an output."""

    def requested(self, message_id: int) -> None:
        """Prepare for a message that a client has requested, once or at an interval."""

    def is_ready(self, message_id: int) -> bool:
        """Whether the extra can send a message; an interval set by a data stream takes effect only then."""
        return True

    def camera_attitude(self, boot_us: float) -> tuple[float, float, float] | None:
        """Return the camera's roll, pitch and heading (rad) at a time since boot; None for straight down."""
        return None

    def log_frame(self, frame: bytes, message_id: int, now_s: float) -> None:
        """Log a frame that the vehicle sent or received."""

    def metadata(self) -> tuple[Message, ...]:
        """Return COMPONENT_METADATA messages; empty if the extra has none."""
        return ()


_Maker: TypeAlias = Callable[[WireState, ParameterSet, PlanReceiver], VehicleExtra]


@cache
def _makers() -> tuple[_Maker, ...]:
    entries = sorted(entry_points(EXTRA_GROUP), key=lambda entry: entry.name)
    return tuple(load_entry(entry, f"vehicle extra {entry.name}", VehicleError) for entry in entries)


def extras_of(state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> tuple[VehicleExtra, ...]:
    """Make the extras of a vehicle.

    Raises
    ------
    VehicleError
        If a package that provides an extra cannot be loaded.
    """
    return tuple(make(state, parameters, plans) for make in _makers())
