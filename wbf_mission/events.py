"""Events of a run, in one stream to which the terminal, files and pages listen.

The run publishes each event once, with `EventStream.tell`. Listeners are called in the thread that published
the event (`Estimated` in the thread of the estimate). A listener must therefore be quick, copy the arrays
that it keeps, and lock its shared state. Times are seconds since the start of the run; positions are metres
in the farm frame.
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
    farm: Farm | None  # None if the farm of the watched vehicles is unknown
    fields: FieldSet | None
    vehicles: tuple[VehicleInfo, ...] = ()
    simulated: bool = True
    seed: int | None = None
    estimator: str | None = None
    planner: str | None = None  # Name of the planner or policy, with its parameters


@dataclass(frozen=True, slots=True, eq=False)
class DayBegun:
    """Start of a day of the environment; `truth`, float32[n, W, H], is known only in a simulation."""

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
    duration_s: float | None = None  # Predicted
    length_m: float | None = None
    coverage: float | None = None  # Predicted share of the land that the images cover


@dataclass(frozen=True, slots=True)
class VehicleMoved:
    """State of a vehicle from its telemetry; None for values missing from the telemetry."""

    time_s: float
    day: int
    flight: int
    system_id: int
    x_m: float
    y_m: float
    height_m: float  # Above home
    speed_m_s: float  # Over ground
    heading_rad: float | None = None  # Compass heading
    battery: float | None = None  # Fraction left
    mode: str = ""
    armed: bool = False
    item: int | None = None  # Index of the current item in `Mission.items`
    items: int | None = None
    phase: str = ""  # Phase of the ground station (`mission.outcome.Phase`), in words
    link_quality: float | None = None  # Fraction of the frames that arrived
    silent_s: float = 0.0  # Time since the last message

    @classmethod
    def of(
        cls, state: VehicleState, frame: LocalFrame, number: tuple[float, int, int, int], **known: Any
    ) -> VehicleMoved:
        """Return the event of a state in a farm's frame; `number` is (time_s, day, flight, system_id)."""
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
    """New readings of cells; their time 0 is `offset_s` after the start of the run."""

    offset_s: float
    observations: Observations


@dataclass(frozen=True, slots=True, eq=False)
class Estimated:
    """Estimate at a scored time; its arrays may be shared with the estimator.

    A finished run keeps `model` for few of its scored times.
    """

    time_s: float
    day: int
    observations: int
    model: InformationModel | None
    score: Score | None


@dataclass(frozen=True, slots=True, eq=False)
class Decided:
    """Decision of a policy; the outcome in `record` changes while the decision is carried out."""

    time_s: float
    record: DecisionRecord
    acquisition: AcquisitionMap | None = None  # Map by which the policy decided


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

    severity: str  # "error", "warning" or "note"
    code: str  # Name of the rule
    text: str
    vehicle: str = ""  # Prefix of the line, such as ``"vehicle 2: "``, if several vehicles fly
    refuses: bool = False  # The plan is refused for this finding; an error with the same text follows


@dataclass(frozen=True, slots=True)
class Asked:
    """Question to the operator with its valid answers; an empty question once it is answered."""

    question: str
    answers: tuple[str, ...] = ()
    # An answer names the number of its question, so a late answer to an older question is ignored.
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
        """A copy in another process has no listeners."""
        return EventStream, ()

    def listen(self, listener: Callable[[Any], None], *kinds: type) -> None:
        """Add a listener to all later events, or only to those of the given `kinds`."""
        self._listeners.append((listener, kinds))

    def wants(self, kind: type) -> bool:
        """Return whether any listener takes events of `kind`; other events need not be made."""
        return any(not kinds or issubclass(kind, kinds) for _, kinds in self._listeners)

    def tell(self, event: Event) -> None:
        """Pass an event to its listeners."""
        for listener, kinds in self._listeners:
            if not kinds or isinstance(event, kinds):
                listener(event)

    def progress(self, what: str, done: float, total: float) -> None:
        """Publish the progress of a task, as a `wbf_mission.progress.Progress`."""
        self.tell(Progressed(what, done, total))

    def note(self, text: str) -> None:
        """Publish a note for the operator."""
        self.tell(Noted(text))

    def warn(self, text: str) -> None:
        """Publish a warning for the operator."""
        self.tell(Noted(text, warns=True))
