"""Messages between the server and a page; `page/src/schema.ts` is made of them by tools/write_page_schema.py.

A page gets an `Update` with everything when it connects, then with what is new since. Times are seconds since
the run began, places metres of the farm frame. What is not finite is null.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

Ring: TypeAlias = list[float]
"""Points, x and y in turn: [x0, y0, x1, y1, ...]."""
Numbers: TypeAlias = list[float | None]
LayerName: TypeAlias = str
"""Layers are named "value/FIELD", "uncertainty/FIELD", "truth/FIELD" or "acquisition"."""


def _as_text(value: Any) -> Any:
    """Return a value of plain ones with all that is no text in its strings replaced."""
    match value:
        case str():
            return value.encode("utf-8", "replace").decode()
        case dict():
            return {_as_text(key): _as_text(one) for key, one in value.items()}
        case list() | tuple():
            return [_as_text(one) for one in value]
    return value


class Georeference(Struct):
    """Degrees of the frame's origin, and their change for each metre along x and y."""

    lat: float
    lon: float
    lat_x: float
    lat_y: float
    lon_x: float
    lon_y: float


class PatchShape(Struct):
    """A patch: its outline first, then its holes."""

    name: str
    crop: str
    own: bool
    rings: list[Ring]


class ObstacleShape(Struct):
    """An obstacle or a no-fly zone."""

    name: str
    height_m: float | None  # None for a no-fly zone, or an obstacle that is too high to be flown over
    rings: list[Ring]


class FarmShape(Struct):
    """The land."""

    name: str
    georeference: Georeference
    width_m: float
    height_m: float
    home_m: tuple[float, float]
    patches: list[PatchShape]  # In the order of painting: later ones lie over earlier ones
    obstacles: list[ObstacleShape]
    rally_m: list[tuple[float, float]]


class FieldInfo(Struct):
    """A field."""

    name: str
    title: str
    kind: Literal["disease", "continuous", "measured"]
    unit: str
    range: tuple[float, float]  # What 0 and 1 stand for
    colours: tuple[str, ...]
    """Two or more, "#rrggbb", from 0 to 1; none where they are those of its kind, which the page has."""


class Raster(Struct):
    """The pixels of all layers: means of the owner's cells that grow what the field concerns."""

    width: int
    height: int  # Pixels along x and y; pixel (0, 0) is at the frame's origin
    pixel_m: float
    cells: int  # Along a side of a pixel
    tile: int  # Pixels along a side of a tile


class Tile(Struct):
    """Pixels of a part of a layer, in place of its tile there; a part that never came holds nothing."""

    layer: LayerName
    x: int
    y: int  # It begins at pixel (x * tile, y * tile); those at the far borders are cut off by them
    data: str
    """A byte a pixel, row by row from the bottom up: 0 to 254 for 0 to the layer's scale, 255 where there is
    nothing; packed by zlib, in base64."""


class VehicleInfo(Struct):
    """A vehicle that takes part."""

    system_id: int
    name: str
    kind: str


class FenceShape(Struct):
    """A part of a geofence."""

    rings: list[Ring]
    inclusion: bool


class Plan(Struct):
    """What a vehicle is to fly from a time on."""

    system_id: int
    day: int
    flight: int
    time_s: float
    path: Ring
    fence: list[FenceShape]
    items: list[str]  # In words, in the order of the mission's items
    duration_s: float | None
    length_m: float | None
    coverage: float | None


class States(Struct):
    """States of one vehicle as columns, one entry for each moment."""

    time_s: list[float]
    day: list[int]
    flight: list[int]
    x: list[float]
    y: list[float]
    height_m: Numbers
    speed_m_s: Numbers
    heading_deg: Numbers
    battery: Numbers
    link: Numbers
    item: list[int | None]
    items: list[int | None]
    mode: list[str]
    phase: list[str]
    armed: list[bool]
    silent_s: list[float]


class Readings(Struct):
    """Readings of cells as columns."""

    time_s: list[float]
    x: list[float]
    y: list[float]
    values: dict[str, Numbers]
    """By field, null where the camera told nothing, and where none of the field's crops grows."""


class Scores(Struct):
    """Estimates as columns; the losses by field."""

    time_s: list[float]
    day: list[int]
    observations: list[int]
    score: Numbers
    losses: dict[str, Numbers]


class Candidate(Struct):
    """A path that was thought of."""

    system_id: int
    path: Ring
    value: float
    cost: float


class Change(Struct):
    """A path that was chosen, and what became of it."""

    system_id: int
    path: Ring
    cost: float
    outcome: str


class Decision(Struct):
    """An answer of a policy, in place of one with its number: outcomes change while it is carried out."""

    number: int
    time_s: float
    day: int
    flight: int
    event: str
    reason: str
    refused: str
    compute_s: float
    candidates: list[Candidate]  # The best first
    changes: list[Change]


class Said(Struct):
    """A line of a vehicle's or of the program's."""

    time_s: float
    system_id: int  # 0 for a note of the program's own
    severity: int
    text: str


class Progress(Struct):
    """How far some work is."""

    what: str
    done: float
    total: float


class Question(Struct):
    """What the operator is asked."""

    text: str
    answers: tuple[str, ...]
    number: int


class Status(Struct):
    """How the run is going."""

    outcome: str  # "running", or how the run ended
    words: str  # The same as people read it
    reason: str
    progress: Progress | None
    question: Question | None
    orders: tuple[str, ...]  # Orders that this page may give; none where it only shows


class Run(Struct):
    """What is flown."""

    title: str
    simulated: bool
    seed: int | None
    estimator: str | None
    planner: str | None
    farm: FarmShape | None
    fields: list[FieldInfo]
    raster: Raster | None
    vehicles: list[VehicleInfo]


class Background(Struct):
    """The user's own map tiles."""

    attribution: str
    min_zoom: int
    max_zoom: int


class Reply(Struct):
    """The outcome of the request with this number, sent to its page only."""

    order: str
    error: str
    number: int


class Beat(Struct):
    """A sign of life of the program, once a second, after all that was new."""

    time_s: float  # On the program's own clock, since this page was connected
    silent_s: dict[str, float]
    """Age of each vehicle's newest state, by system id; of none in a simulation, whose time may stand."""


class Update(Struct, omit_defaults=True):
    """What is new; what is missing did not change.

    Lists and columns are appended; the others replace what there is (`tiles`, `decisions` each its own kind).
    """

    time_s: float
    restart: list[str] | UnsetType = UNSET
    """Emptied before the rest is taken: "plans", "said", "decisions", "scores", "states/SYSTEM_ID", whose
    older rows were thinned out; "tiles", all layers and their scales."""
    run: Run | UnsetType = UNSET
    plans: list[Plan] | UnsetType = UNSET
    states: dict[str, States] | UnsetType = UNSET
    readings: Readings | UnsetType = UNSET
    scores: Scores | UnsetType = UNSET
    decisions: list[Decision] | UnsetType = UNSET
    said: list[Said] | UnsetType = UNSET
    tiles: list[Tile] | UnsetType = UNSET
    scales: dict[LayerName, float] | UnsetType = UNSET
    """What 254 stands for, by layer; all of them with every update that has tiles."""
    status: Status | UnsetType = UNSET
    background: Background | UnsetType | None = UNSET
    reply: Reply | UnsetType = UNSET
    beat: Beat | UnsetType = UNSET

    def json(self) -> bytes:
        """Return it as a page reads it."""
        try:
            return msgspec.json.encode(self)
        except UnicodeEncodeError:  # Names of files may hold what is no text
            return msgspec.json.encode(_as_text(msgspec.to_builtins(self)))


class Moment(Struct):
    """The layers as they were from a time on."""

    time_s: float
    day: int
    observations: int
    tiles: list[Tile]
    scales: dict[LayerName, float]  # What 254 stands for in its tiles


class Recording(Update, kw_only=True):
    """A finished run in a page of its own: all of it, and the layers as they were at some moments."""

    moments: list[Moment]  # In the order of their times; tiles of each replace those of the ones before


Positive: TypeAlias = Annotated[float, Meta(ge=0.0, le=1e9)]
Number: TypeAlias = Annotated[int, Meta(ge=1, le=2**53)]


class Given(Struct, forbid_unknown_fields=True):
    """The time of a request: the newest beat of the page, and the seconds since then on its own clock."""

    number: Number  # Greater than those before: each request counts once
    beat_s: Positive
    after_s: Positive


class Order(Struct, forbid_unknown_fields=True):
    """An order of a page to vehicles."""

    order: Annotated[str, Meta(min_length=1, max_length=40)]
    system_ids: Annotated[list[Annotated[int, Meta(ge=0, le=255)]], Meta(min_length=1, max_length=256)]
    given: Given
    value: Annotated[str, Meta(max_length=200)] = ""
    confirmed: bool = False


class Answer(Struct, forbid_unknown_fields=True):
    """An answer of a page to the operator's question with this number."""

    answer: Annotated[str, Meta(max_length=200)]
    question: Annotated[int, Meta(ge=0, le=2**53)]
    given: Given
