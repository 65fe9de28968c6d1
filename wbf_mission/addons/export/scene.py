"""Code that all exports share: places, colours, pixels, and the loop over the events of a run."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.errors import WbfMissionError
from mission.model import Command, Frame, Mission
from mission.outcome import in_words
from sensors.observations import Observations
from wbf_mission import events
from wbf_mission.addons.base.plots import CROP_COLOURS, LINE_COLOURS, rgb
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import pixel_means

if TYPE_CHECKING:
    from wbf_mission.run.record import RunRecord

OBSTACLE, FENCE, _LAND = "#b22222", "#e69f00", "#8c8c8c"
SHOWN_AGAIN = 100  # Number of times per run at which tracks and readings are written again as a whole.
TRACK_POINTS = 1000  # Maximum number of points in a displayed track.
LONGEST = 500
"""Maximum number of pixels along the longer side of a farm; smaller farms get one pixel per cell."""
WARNING, INFO = 4, 6  # Values of MAV_SEVERITY.
_LEAST_SHARE = 0.02  # Minimum top of a disease's colour scale on large farms (fraction of sick plants).
_UNCERTAIN = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")  # Five colours of matplotlib's viridis.

Pixels = NDArray[np.float32]
Colours = NDArray[np.uint8]


class ExportError(WbfMissionError, ValueError):
    """The run cannot be exported."""


def vehicle_colour(system_id: int) -> str:
    """Return the colour of a vehicle, ``#rrggbb``."""
    return LINE_COLOURS[(system_id - 1) % len(LINE_COLOURS)]


def crop_colour(crop: str) -> str:
    """Return the colour of a crop; an unknown crop gets the colour of bare land."""
    return CROP_COLOURS.get(crop, _LAND)


def places_of(farm: Farm, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return latitude and longitude, float64[n, 2], of points in the farm's frame, float64[n, 2 or more]."""
    return np.column_stack(farm.frame.to_wgs84(points_m[:, 0].copy(), points_m[:, 1].copy()))


def waypoints_of(mission: Mission, farm: Farm) -> list[tuple[float, float, float]]:
    """Return latitude, longitude and height above home of a mission's waypoints."""
    home_m = farm.frame.altitude_m if mission.home is None else mission.home.altitude_m
    return [
        (item.x, item.y, item.z - (home_m if item.frame == Frame.GLOBAL else 0.0))
        for item in mission.items
        if item.command == Command.NAV_WAYPOINT
    ]


def highest_m(mission: Mission, farm: Farm) -> float:
    """Return the height above home of a mission's highest waypoint (m); 0 without waypoints."""
    return max((height_m for *_, height_m in waypoints_of(mission, farm)), default=0.0)


class Scene(ABC):
    """A file that shows a run: `take` passes each event to a method, which each file format implements."""

    def __init__(self, record: RunRecord) -> None:
        self.farm, self.fields = farm, fields = record.farm, record.fields
        width, height = farm.width_cells, farm.height_cells
        self.size_m = max(width, height) * farm.cell_size_m / 60
        """Size of a vehicle's symbol, large enough for a view of the whole farm."""
        self._grid = MapGrid((width, height), farm.cell_size_m, -(-max(width, height) // LONGEST), 1)
        self.pixel_m = self._grid.pixel * self._grid.cell_size_m
        self._masks = fields.masks(farm.grid())
        self._scales = _scales(record) if self._grid.pixel > 1 else [1.0] * len(fields)
        self._doubts = [0.0] * len(fields)  # Tops of the colour scales of uncertainty, from the first values.
        self._seen: list[Observations] = []  # Readings of the current day.
        self._readings, self._readings_a_show = 0, max(1, len(record.observations) // SHOWN_AGAIN)

    def take(self, event: events.Event) -> None:
        """Write an event."""
        match event:
            case events.RunBegun():
                self._begin(event)
                self._say(0.0, INFO, "run", event.title)
            case events.DayBegun():
                self._seen = []
                if event.truth is not None:
                    self._draw(event.time_s, "truth", event.truth)
            case events.Planned():
                self._plan(event)
            case events.VehicleMoved():
                self._move(event)
            case events.VehicleSaid():
                self._say(event.time_s, event.severity, f"vehicle {event.system_id}", event.text)
            case events.Seen():
                self._seen.append(event.observations)
                self._readings += len(event.observations)
                if self._readings >= self._readings_a_show:
                    self._add_readings(event.offset_s + float(event.observations.time_s.max()))
            case events.Estimated():
                self._score(event)
                if event.model is not None:
                    self._draw(event.time_s, "estimate", event.model.value)
                    self._draw(event.time_s, "uncertainty", event.model.uncertainty)
            case events.Decided():
                self._decide(event)
                record = event.record
                if text := record.refused or record.reason:
                    self._say(event.time_s, WARNING if record.refused else INFO, "policy", text)
            case events.FlightEnded():
                self._land(event)
                text = in_words(event.outcome, event.reason)
                self._say(event.time_s, INFO, f"vehicle {event.system_id}", text)
            case events.RunEnded():
                self._add_readings(event.time_s)
                self._say(event.time_s, INFO, "run", in_words(event.outcome, event.reason))
            case _:
                pass

    def _add_readings(self, time_s: float) -> None:
        self._readings = 0
        seen = Observations.concatenate(self._seen, self.fields.names)
        places_m = self.farm.cell_size_m * (np.stack([seen.x, seen.y], 1) + np.float64(0.5))
        # A reading has the colour of its worst disease, or of the first field if no field is a disease.
        shown = [k for k, field in enumerate(self.fields) if field.kind == "disease"] or [0]
        worst = np.fmin.reduce(seen.values[:, shown], axis=1)
        self._show_readings(time_s, places_m, seen.values, _painted(worst, self.fields[shown[0]].colours))

    def _draw(self, time_s: float, what: str, values: Pixels) -> None:
        """Draw the pixel means and colours of each field's values.

        For a disease on a large farm, the scale ends at the highest fraction of sick plants in a pixel.
        """
        for k, (field, mask) in enumerate(zip(self.fields, self._masks, strict=True)):
            means = pixel_means(self._grid, mask, values[k]).astype(np.float32)
            if what == "uncertainty":
                self._doubts[k] = self._doubts[k] or max(float(np.nanmax(means, initial=0.0)), 1e-3)
                colours = _painted(means / self._doubts[k], _UNCERTAIN)
            else:
                colours = _painted(1.0 - (1.0 - means) / self._scales[k], field.colours)
            self._show_layer(time_s, f"{field.name}/{what}", means, colours)

    @abstractmethod
    def _begin(self, event: events.RunBegun) -> None: ...

    @abstractmethod
    def _say(self, time_s: float, severity: int, name: str, text: str) -> None: ...

    @abstractmethod
    def _plan(self, event: events.Planned) -> None: ...

    @abstractmethod
    def _move(self, event: events.VehicleMoved) -> None: ...

    @abstractmethod
    def _land(self, event: events.FlightEnded) -> None: ...

    @abstractmethod
    def _score(self, event: events.Estimated) -> None: ...

    def _decide(self, event: events.Decided) -> None: ...  # noqa: B027

    @abstractmethod
    def _show_readings(
        self, time_s: float, places_m: NDArray[np.float64], values: Pixels, colours: Colours
    ) -> None:
        """Show all readings of the current day: places [n, 2], values [n, fields], colours uint8[n, 4]."""

    @abstractmethod
    def _show_layer(self, time_s: float, name: str, means: Pixels, colours: Colours) -> None:
        """Show a layer: means float32[x pixels, y pixels], NaN outside the field; colours uint8[..., 4]."""


def _scales(record: RunRecord) -> list[float]:
    """Return the top of each field's colour scale: a disease's highest fraction of sick plants, else 1."""
    scales = [1.0] * len(record.fields)
    for k, (field, shown) in enumerate(zip(record.fields, record.true_maps or record.maps, strict=False)):
        if field.kind == "disease":
            scales[k] = max(_LEAST_SHARE, float(np.nanmax(shown.share, initial=0.0)))
    return scales


def _painted(shown: NDArray[np.floating], colours: Iterable[str]) -> Colours:
    """Map values from 0 to 1 to a colour scale; unknown values are transparent."""
    known = np.isfinite(shown)
    scale = np.array([rgb(colour) for colour in colours], np.float64)
    at = np.linspace(0.0, 1.0, len(scale))
    # Unknown pixels are white and transparent, because some tools ignore opacity.
    painted = np.full((*shown.shape, 4), (255, 255, 255, 0), np.uint8)
    for part in range(3):
        painted[known, part] = np.rint(np.interp(shown[known], at, scale[:, part]))
    painted[known, 3] = 255
    return painted
