"""Events of a run, and the stream that passes them to the terminal, files and pages.

The run publishes each event once, with `EventStream.tell`. Listeners are called in the thread that publishes
the event (for `Estimated`, the estimate's thread). A listener must therefore be quick, copy the arrays that
it keeps, and lock its shared state. Times are seconds since the start of the run; positions are metres in the
farm frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geo import Farm
    from geo.frame import LocalFrame
    from mission.ground.vehicle_state import VehicleState
    from mission.model import Mission
    from mission.policies.decision import AcquisitionMap
    from sensors.fields import FieldSet
    from sensors.observations import Observations
    from sensors.scoring.information import InformationModel
    from sensors.scoring.score import Score
    from wbf_mission.replanning.record import DecisionRecord


@dataclass(frozen=True, slots=True)
class VehicleInfo:
    """A vehicle of the run, identified by its MAVLink system id."""

    system_id: int
    name: str
    kind: str  # "copter", "plane", "rover" or another kind of airframe; empty if unknown


@dataclass(frozen=True, slots=True, eq=False)
class RunBegun:
    """Description of the run: the first event, repeated when another vehicle is discovered."""

    title: str
    farm: Farm | None  # None if it is unknown over which farm the watched vehicles fly
    fields: FieldSet | None
    vehicles: tuple[VehicleInfo, ...] = ()
    simulated: bool = True
    seed: int | None = None
    estimator: str | None = None
    planner: str | None = None  # Name of the planner or policy, with its parameters


@dataclass(frozen=True, slots=True, eq=False)
class DayBegun:
    """Start of a day of the environment; only a simulation knows the `truth`, float32[n, W, H]."""

    time_s: float
    day: int
    truth: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A vehicle's planned mission, published before each flight and after each change in flight."""

    time_s: float
    day: int
    flight: int
    system_id: int
    mission: Mission
    path_m: NDArray[np.float64]  # float64[n, 2]
    duration_s: float | None = None  # Predicted duration
    length_m: float | None = None
    coverage: float | None = None  # Predicted fraction of the land that the images cover


@dataclass(frozen=True, slots=True)
class VehicleMoved:
    """State of a vehicle from its telemetry; values missing from the telemetry are None."""

    time_s: float
    day: int
    flight: int
    system_id: int
    x_m: float
    y_m: float
    height_m: float  # Above home.
    speed_m_s: float  # Over ground.
    heading_rad: float | None = None  # Compass heading.
    battery: float | None = None  # Fraction left.
    mode: str = ""
    armed: bool = False
    item: int | None = None  # Index of the current item in `Mission.items`
    items: int | None = None
    phase: str = ""  # Phase of the ground station (`mission.outcome.Phase`), in words.
    link_quality: float | None = None  # Fraction of the MAVLink frames that arrived.
    silent_s: float = 0.0  # Time since the last message.

    @classmethod
    def of(
        cls, state: VehicleState, frame: LocalFrame, number: tuple[float, int, int, int], **known: Any
    ) -> VehicleMoved:
        """Return the event for a vehicle's state; `number` is (time_s, day, flight, system_id)."""
        x_m, y_m = state.position_m(frame)
        return cls(
            *number,
            x_m,
            y_m,
            state.height_m,
            state.ground_speed_m_s,
            heading_rad=state.heading_rad,
            battery=state.battery.remaining,
            armed=state.armed,
            item=state.item if state.total != 0 else None,
            items=state.total,
            **known,
        )


@dataclass(frozen=True, slots=True)
class VehicleSaid:
    """Text message of a vehicle (STATUSTEXT)."""

    time_s: float
    system_id: int
    severity: int  # MAV_SEVERITY from 0 (emergency) to 7 (debug)
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """New readings of cells; the times of `observations` count from `offset_s` after the start of the run."""

    offset_s: float
    observations: Observations


@dataclass(frozen=True, slots=True, eq=False)
class Estimated:
    """Estimate at a scored time; its arrays may be shared with the estimator.

    A finished run keeps the `model` of only a few scored times.
    """

    time_s: float
    day: int
    observations: int
    model: InformationModel | None
    score: Score | None


@dataclass(frozen=True, slots=True, eq=False)
class Decided:
    """Decision of a policy; `record` is updated while the decision is carried out."""

    time_s: float
    record: DecisionRecord
    acquisition: AcquisitionMap | None = None  # Map on which the policy based its decision


@dataclass(frozen=True, slots=True)
class FlightEnded:
    """End of one vehicle's flight."""

    time_s: float
    day: int
    flight: int
    system_id: int
    outcome: str
    reason: str


@dataclass(frozen=True, slots=True)
class Progressed:
    """Progress of a task: `done` of `total`."""

    what: str
    done: float
    total: float


@dataclass(frozen=True, slots=True)
class Noted:
    """Note or warning for the operator, in one line."""

    text: str
    warns: bool = False


@dataclass(frozen=True, slots=True)
class Found:
    """A finding of the preflight check of a plan."""

    severity: str  # "error", "warning" or "note".
    code: str  # Name of the rule.
    text: str
    vehicle: str = ""  # Prefix of the line, such as ``"vehicle 2: "``, if several vehicles fly.
    refuses: bool = False  # The plan is refused for this finding; an error with the same text follows.


@dataclass(frozen=True, slots=True)
class Asked:
    """Question to the operator with its valid answers; the question is empty once it has been answered."""

    question: str
    answers: tuple[str, ...] = ()
    # An answer carries the number of its question, so a late answer to an earlier question is ignored.
    number: int = field(default=0, compare=False)


@dataclass(frozen=True, slots=True)
class Orderable:
    """Orders that the operator may give now, in words; empty if orders are not possible."""

    orders: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RunEnded:
    """End of the run, with its summary in plain values if there is one."""

    time_s: float
    outcome: str
    reason: str
    summary: Mapping[str, Any] | None = None


Event: TypeAlias = (
    RunBegun
    | DayBegun
    | Planned
    | VehicleMoved
    | VehicleSaid
    | Seen
    | Estimated
    | Decided
    | FlightEnded
    | Progressed
    | Noted
    | Found
    | Asked
    | Orderable
    | RunEnded
)
Listener: TypeAlias = Callable[[Event], None]


class EventStream:
    """Passes each event to all listeners.

    Examples
    --------
    >>> stream, heard = EventStream(), []
    >>> stream.listen(heard.append, Noted)
    >>> stream.tell(Noted("the vehicle is heard"))
    >>> heard[0].text
    'the vehicle is heard'
    >>> stream.wants(Noted), stream.wants(VehicleMoved)
    (True, False)
    """

    def __init__(self) -> None:
        self._listeners: list[tuple[Listener, tuple[type, ...]]] = []

    def __reduce__(self) -> tuple[type[EventStream], tuple[()]]:
        """Pickle the stream without its listeners, which belong to this process."""
        return EventStream, ()

    def listen(self, listener: Callable[[Any], None], *kinds: type) -> None:
        """Add a listener to all later events, or only to those of the given `kinds`."""
        self._listeners.append((listener, kinds))

    def wants(self, kind: type) -> bool:
        """Return whether any listener takes events of `kind`; if none does, such events need not be made."""
        return any(not kinds or issubclass(kind, kinds) for _, kinds in self._listeners)

    def tell(self, event: Event) -> None:
        """Pass an event to its listeners."""
        for listener, kinds in self._listeners:
            if not kinds or isinstance(event, kinds):
                listener(event)

    def progress(self, what: str, done: float, total: float) -> None:
        """Publish the progress of a task; this method is a `wbf_mission.progress.Progress` callback."""
        self.tell(Progressed(what, done, total))

    def note(self, text: str) -> None:
        """Publish a note for the operator."""
        self.tell(Noted(text))

    def warn(self, text: str) -> None:
        """Publish a warning for the operator."""
        self.tell(Noted(text, warns=True))
