"""What happens in a run, as one stream of events that the terminal, files and pages listen to.

Who makes a run tells each event once, by `EventStream.tell`; who shows or keeps it listens. Listeners are
called in the thread in which the event came about (`Estimated` in that of the estimate), so they are quick,
copy the arrays that they keep, and lock what they share. Times are seconds since the run began, places metres
of the farm frame.
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
    """A vehicle that takes part, by its MAVLink system id."""

    system_id: int
    name: str
    kind: str  # "copter", "plane", "rover", or another kind of airframe; empty where it is not known


@dataclass(frozen=True, slots=True, eq=False)
class RunBegun:
    """What is flown: it comes first, and again when more is known (of vehicles that are heard later)."""

    title: str
    farm: Farm | None  # None where nobody says over which farm a watched vehicle flies
    fields: FieldSet | None
    vehicles: tuple[VehicleInfo, ...] = ()
    simulated: bool = True
    seed: int | None = None
    estimator: str | None = None
    planner: str | None = None  # A planner's or a policy's name with its parameters


@dataclass(frozen=True, slots=True, eq=False)
class DayBegun:
    """A day of the environment; its truth, float32[n, W, H], where a simulation knows it."""

    time_s: float
    day: int
    truth: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """What a vehicle is to fly: at the beginning of each flight, and when its mission changes in flight."""

    time_s: float
    day: int
    flight: int
    system_id: int
    mission: Mission
    path_m: NDArray[np.float64]  # float64[n, 2]
    duration_s: float | None = None  # Predicted
    length_m: float | None = None
    coverage: float | None = None  # Predicted share of the land that is to be seen


@dataclass(frozen=True, slots=True)
class VehicleMoved:
    """A vehicle as its telemetry tells of it; None for what it does not tell."""

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
    item: int | None = None  # The item that is flown, counted from 0 as `Mission.items` is
    items: int | None = None
    phase: str = ""  # What the ground station is at (`mission.outcome.Phase`), in words
    link_quality: float | None = None  # Part of the frames that arrived
    silent_s: float = 0.0  # How long nothing was heard

    @classmethod
    def of(
        cls, state: VehicleState, frame: LocalFrame, number: tuple[float, int, int, int], **known: Any
    ) -> VehicleMoved:
        """Return a state in a farm's frame; `number` is when, day, flight and system id."""
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
    """What a vehicle said in words (STATUSTEXT)."""

    time_s: float
    system_id: int
    severity: int  # MAV_SEVERITY, 0 emergency to 7 debug
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Readings of cells that arrived; their own times begin `offset_s` after the run did."""

    offset_s: float
    observations: Observations


@dataclass(frozen=True, slots=True, eq=False)
class Estimated:
    """What is believed at a time that is scored; the arrays may be the estimator's own.

    Of a run that is over there is no model of most times.
    """

    time_s: float
    day: int
    observations: int
    model: InformationModel | None
    score: Score | None


@dataclass(frozen=True, slots=True, eq=False)
class Decided:
    """What a policy answered; its outcome changes while it is carried out."""

    time_s: float
    record: DecisionRecord
    acquisition: AcquisitionMap | None = None  # What it was chosen by


@dataclass(frozen=True, slots=True)
class FlightEnded:
    """One vehicle's flight is over."""

    time_s: float
    day: int
    flight: int
    system_id: int
    outcome: str
    reason: str


@dataclass(frozen=True, slots=True)
class Progressed:
    """How far some work is."""

    what: str
    done: float
    total: float


@dataclass(frozen=True, slots=True)
class Noted:
    """A line for the operator."""

    text: str
    warns: bool = False


@dataclass(frozen=True, slots=True)
class Found:
    """A finding of the preflight check of a plan."""

    severity: str  # "error", "warning" or "note"
    code: str  # Name of the rule
    text: str
    vehicle: str = ""  # Begins the line: ``"vehicle 2: "`` where several fly
    refuses: bool = False  # The plan is refused for it: an error that says the same follows


@dataclass(frozen=True, slots=True)
class Asked:
    """What the operator is asked, with the words that answer it; an empty question when it is answered."""

    question: str
    answers: tuple[str, ...] = ()
    # An answer names it: one to the question before does not answer this one.
    number: int = field(default=0, compare=False)


@dataclass(frozen=True, slots=True)
class Orderable:
    """What who watches may order now, in words; nothing where watching is all."""

    orders: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RunEnded:
    """The run is over: its summary in plain values, as far as there is one."""

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
    """Hands each event to all who listen.

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

    def listen(self, listener: Callable[[Any], None], *kinds: type) -> None:
        """Hand all events from now on to a listener, too, or only those of some kinds."""
        self._listeners.append((listener, kinds))

    def wants(self, kind: type) -> bool:
        """Return whether anybody listens to events of a kind: those that nobody wants need not be made."""
        return any(not kinds or issubclass(kind, kinds) for _, kinds in self._listeners)

    def tell(self, event: Event) -> None:
        """Hand an event on."""
        for listener, kinds in self._listeners:
            if not kinds or isinstance(event, kinds):
                listener(event)

    def progress(self, what: str, done: float, total: float) -> None:
        """Tell how far some work is: a `wbf_mission.progress.Progress`."""
        self.tell(Progressed(what, done, total))

    def note(self, text: str) -> None:
        """Hand on a line for the operator."""
        self.tell(Noted(text))

    def warn(self, text: str) -> None:
        """Hand on a warning for the operator."""
        self.tell(Noted(text, warns=True))
