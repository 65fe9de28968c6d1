"""Messages between the server and a page; tools/write_page_schema.py generates `page/src/schema.ts`.

A page that connects receives an `Update` with all data; later updates have only new data. Times are seconds
since the start of the run, places are metres in the farm frame. Infinite and missing numbers are null.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

Ring: TypeAlias = list[float]
"""Points, alternating x and y: [x0, y0, x1, y1, ...]."""
Numbers: TypeAlias = list[float | None]
LayerName: TypeAlias = str
"""Name of a layer: "value/FIELD", "uncertainty/FIELD", "truth/FIELD" or "acquisition"."""


def _as_text(value: Any) -> Any:
    """Replace characters that UTF-8 cannot encode in the strings of a plain value."""
    match value:
        case str():
            return value.encode("utf-8", "replace").decode()
        case dict():
            return {_as_text(key): _as_text(part) for key, part in value.items()}
        case list() | tuple():
            return [_as_text(part) for part in value]
    return value


class Georeference(Struct):
    """Latitude and longitude of the frame's origin, and their change per metre along x and y (degrees)."""

    lat: float
    lon: float
    lat_x: float
    lat_y: float
    lon_x: float
    lon_y: float


class PatchShape(Struct):
    """A patch of land: its outline, then its holes."""

    name: str
    crop: str
    own: bool
    rings: list[Ring]


class ObstacleShape(Struct):
    """An obstacle or a no-fly zone."""

    name: str
    height_m: float | None  # None for a no-fly zone, or an obstacle too high to fly over
    rings: list[Ring]


class FarmShape(Struct):
    """Map of the farm."""

    name: str
    georeference: Georeference
    width_m: float
    height_m: float
    home_m: tuple[float, float]
    patches: list[PatchShape]  # In drawing order: later patches cover earlier ones
    obstacles: list[ObstacleShape]
    rally_m: list[tuple[float, float]]


class FieldInfo(Struct):
    """A field with its unit and colours."""

    name: str
    title: str
    kind: Literal["disease", "continuous", "measured"]
    unit: str
    range: tuple[float, float]  # Values in `unit` that 0 and 1 stand for
    colours: tuple[str, ...]
    """Two or more "#rrggbb" from 0 to 1; empty if the page's colours for this kind are used."""


class Raster(Struct):
    """Pixels of all layers: means over owned cells of the field's crops."""

    width: int
    height: int  # Pixels along x and y; pixel (0, 0) is at the frame's origin
    pixel_m: float
    cells: int  # Cells along a side of a pixel
    tile: int  # Pixels along a side of a tile


class Tile(Struct):
    """New pixels of a part of a layer; a part for which no tile was sent is empty."""

    layer: LayerName
    x: int
    y: int  # The tile starts at pixel (x * tile, y * tile); tiles at the far borders are smaller
    data: str
    """One byte per pixel, row by row from the bottom: bytes 0 to 254 stand for 0 to the layer's scale, 255
    for no value. The bytes are compressed by zlib and coded in base64."""


class VehicleInfo(Struct):
    """A vehicle of the run."""

    system_id: int
    name: str
    kind: str


class FenceShape(Struct):
    """A part of a geofence."""

    rings: list[Ring]
    inclusion: bool


class Plan(Struct):
    """A path that a vehicle is planned to fly from `time_s` on."""

    system_id: int
    day: int
    flight: int
    time_s: float
    path: Ring
    fence: list[FenceShape]
    items: list[str]  # Descriptions of the mission's items, in order
    duration_s: float | None
    length_m: float | None
    coverage: float | None


class States(Struct):
    """States of one vehicle as columns, one entry per time."""

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
    """Values by field; null if there is no reading, or outside the field's crops."""


class Scores(Struct):
    """Scores of the estimates over time, as columns; losses by field."""

    time_s: list[float]
    day: list[int]
    observations: list[int]
    score: Numbers
    losses: dict[str, Numbers]


class Candidate(Struct):
    """A path that a policy considered."""

    system_id: int
    path: Ring
    value: float
    cost: float


class Change(Struct):
    """A path that a policy chose, and its outcome."""

    system_id: int
    path: Ring
    cost: float
    outcome: str


class Decision(Struct):
    """A decision of a policy; it replaces its older version, as outcomes change while it is executed."""

    number: int
    time_s: float
    day: int
    flight: int
    event: str
    reason: str
    refused: str
    compute_s: float
    candidates: list[Candidate]  # Best first
    changes: list[Change]


class Said(Struct):
    """A message of a vehicle or of the program."""

    time_s: float
    system_id: int  # 0 for the program
    severity: int
    text: str


class Progress(Struct):
    """Progress of a task."""

    what: str
    done: float
    total: float


class Question(Struct):
    """A question to the operator."""

    text: str
    answers: tuple[str, ...]
    number: int


class Status(Struct):
    """State of the run."""

    outcome: str  # "running", or the outcome of the run
    words: str  # The outcome in words
    reason: str
    progress: Progress | None
    question: Question | None
    orders: tuple[str, ...]  # Orders that this page may give; empty if it may give no orders


class Run(Struct):
    """The run: its title, farm, fields and vehicles."""

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
    """Outcome of the request with this number, sent only to its page."""

    order: str
    error: str
    number: int


class Beat(Struct):
    """Heartbeat of the program, once per second, after all new data."""

    time_s: float  # Time on the program's own clock since this page connected
    silent_s: dict[str, float]
    """Age of each vehicle's newest state, by system id; empty in a simulation, where time may stop."""


class Update(Struct, omit_defaults=True):
    """New data; a missing member is unchanged.

    Rows of lists and columns are appended. Other members are replaced whole, `tiles` and `decisions` by item.
    """

    time_s: float
    restart: list[str] | UnsetType = UNSET
    """Members to empty first: "plans", "said", "decisions", "scores" and "states/SYSTEM_ID", if older rows
    were thinned out; "tiles" for all layers and scales."""
    run: Run | UnsetType = UNSET
    plans: list[Plan] | UnsetType = UNSET
    states: dict[str, States] | UnsetType = UNSET
    readings: Readings | UnsetType = UNSET
    scores: Scores | UnsetType = UNSET
    decisions: list[Decision] | UnsetType = UNSET
    said: list[Said] | UnsetType = UNSET
    tiles: list[Tile] | UnsetType = UNSET
    scales: dict[LayerName, float] | UnsetType = UNSET
    """Value of byte 254, by layer; complete in every update with tiles."""
    status: Status | UnsetType = UNSET
    background: Background | UnsetType | None = UNSET
    reply: Reply | UnsetType = UNSET
    beat: Beat | UnsetType = UNSET

    def json(self) -> bytes:
        """Return the update as JSON."""
        try:
            return msgspec.json.encode(self)
        except UnicodeEncodeError:  # File names may contain bytes that are not text
            return msgspec.json.encode(_as_text(msgspec.to_builtins(self)))


class Moment(Struct):
    """A moment of a recording: the changes of its layers at one time."""

    time_s: float
    day: int
    observations: int
    tiles: list[Tile]
    scales: dict[LayerName, float]  # Value of byte 254 in its tiles


class Recording(Update, kw_only=True):
    """A finished run within a page: all data, and the layers at some moments."""

    moments: list[Moment]  # In order of time; a tile replaces the same tile of earlier moments


Positive: TypeAlias = Annotated[float, Meta(ge=0.0, le=1e9)]
Number: TypeAlias = Annotated[int, Meta(ge=1, le=2**53)]


class Given(Struct, forbid_unknown_fields=True):
    """Time of a request: the page's newest beat, and the seconds since this beat by the page's clock."""

    number: Number  # Greater than all earlier numbers: each request counts once
    beat_s: Positive
    after_s: Positive


class Order(Struct, forbid_unknown_fields=True):
    """An order from a page to vehicles."""

    order: Annotated[str, Meta(min_length=1, max_length=40)]
    system_ids: Annotated[list[Annotated[int, Meta(ge=0, le=255)]], Meta(min_length=1, max_length=256)]
    given: Given
    value: Annotated[str, Meta(max_length=200)] = ""
    confirmed: bool = False


class Answer(Struct, forbid_unknown_fields=True):
    """An answer from a page to the question with this number."""

    answer: Annotated[str, Meta(max_length=200)]
    question: Annotated[int, Meta(ge=0, le=2**53)]
    given: Given
