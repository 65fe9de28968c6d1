"""Animation of a run: the vehicles, and the truth, estimate and uncertainty of each field, over time.

A run stores no intermediate estimates. A fresh estimator learns the observations again, in the order of
their arrival. To save memory, only the pixel means of truth and estimates are kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from threadpoolctl import threadpool_limits

from geo.atomic import atomic_path
from geo.errors import WbfMissionError
from mission.ground.tracks import Track
from sensors.estimators import Estimator
from sensors.fields import Field
from wbf_mission.addons.base.replay import estimates_again, flights_of, fresh_estimator, kept_truths
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import pixel_means
from wbf_mission.progress import Progress, silent
from wbf_mission.run.record import FlightRecord
from wbf_mission.run.resolve import make_environment

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D

    from sensors.environment.environment import Environment
    from wbf_mission.run.record import RunRecord
    from wbf_mission.scenario import Scenario

MOST_FRAMES = 300
_FRAMES = 150
_FRAMES_A_SECOND = 12
_LARGEST_SHARE = 0.02  # Minimum for the top of the colour scale of sick plants, on large farms.
_COLUMNS = ("truth", "estimate", "uncertainty")
# Only the path of the last seconds (but at least of one frame) is drawn: a whole path would hide the maps.
_TAIL_S = 30.0
_MARGIN = 0.02
_UNCERTAIN = "viridis"
# Number of cell columns that are read at a time: on a large farm, the whole truth would take much memory.
_STRIP_CELLS = 500
_VEHICLES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#000000")

_Floats = NDArray[np.float64]


class AnimationError(WbfMissionError, ValueError):
    """The run cannot be animated, or the file name or the number of frames is invalid."""


@dataclass(frozen=True, slots=True)
class Moment:
    """Moment of a run that one frame shows."""

    flights: tuple[FlightRecord, ...]  # Simultaneous flights of all vehicles.
    time_s: float  # Time since the start of these flights, as in their tracks.
    seen: int  # Number of observations known at this moment.

    @property
    def day(self) -> int:
        """Day of the environment at this moment."""
        return self.flights[0].day


def moments(record: RunRecord, frames: int) -> list[Moment]:
    """Return about `frames` moments of a run, evenly spaced over the time in the air.

    The moments include the start and the end of each flight.
    """
    flights = flights_of(record)
    times = [[one.track.time_s for one in flight.records if len(one.track.time_s)] for flight in flights]
    ends = [max((float(time_s[-1]) for time_s in group), default=0.0) for group in times]
    begins = [min((float(time_s[0]) for time_s in group), default=0.0) for group in times]
    whole_s = sum(ends) - sum(begins)
    found = []
    for flight, begin_s, end_s in zip(flights, begins, ends, strict=True):
        share = (end_s - begin_s) / whole_s if whole_s > 0.0 else 0.0
        times_s = np.linspace(begin_s, end_s, max(2, round(share * frames)))
        part = record.observations[flight.seen]
        # A lost image that was fetched again arrives after later images.
        known_s = np.maximum.accumulate(part.time_s) if len(part) else np.empty(0)
        for time_s in times_s.tolist():
            seen = int(np.searchsorted(known_s, time_s, side="right"))
            found.append(Moment(flight.records, time_s, flight.seen.start + seen))
        found[-1] = Moment(flight.records, end_s, flight.seen.stop)
    return found


def animate(
    record: RunRecord,
    path: Path,
    *,
    frames: int = _FRAMES,
    estimator: Estimator | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write the animation of a run as .gif or .mp4; parameters and errors are as in `Result.animate`."""
    if not 2 <= frames <= MOST_FRAMES:
        raise AnimationError(f"animation: {frames} frames; give 2 to {MOST_FRAMES}")
    if path.suffix not in (".gif", ".mp4"):
        raise AnimationError(f"{path}: an animation must be a .gif or .mp4 file")
    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise AnimationError(f"{path}: ffmpeg is not installed; give a .gif file")
    shown = moments(record, frames)
    if not any(len(flight.track.time_s) for flight in record.flights):
        raise AnimationError("animation: nothing was flown")
    progress = progress or silent
    with threadpool_limits(1, user_api="blas"):
        learner = fresh_estimator(record, progress, estimator)
        steps_s = [b.time_s - a.time_s for a, b in pairwise(shown) if a.flights is b.flights]
        sheet = _Sheet(record, max([_TAIL_S, *steps_s]))
        writer: Any = FFMpegWriter(fps=_FRAMES_A_SECOND, extra_args=["-f", "mp4"])
        if path.suffix == ".gif":
            writer = GifWriter(_FRAMES_A_SECOND, sheet.colour_maps, _VEHICLES)
        with atomic_path(path) as temporary, writer.saving(sheet.figure, str(temporary), sheet.figure.dpi):
            for number, (moment, maps) in enumerate(_estimates(record, learner, shown)):
                progress("animation", number, len(shown))
                sheet.show(moment, *maps)
                writer.grab_frame()
    return path


_Maps = tuple[list[_Floats], list[_Floats], list[_Floats]]


def _estimates(
    record: RunRecord, estimator: Estimator, shown: list[Moment]
) -> Iterator[tuple[Moment, _Maps]]:
    """Yield each moment with the pixel means of truth, estimate and uncertainty of each field."""
    farm, fields = record.farm, record.fields
    grid, masks = MapGrid.of(farm), fields.masks(farm.grid())
    environment = cache(partial(make_environment, record.scenario, farm))
    day, truth = None, list[_Floats]()
    known: tuple[list[_Floats], list[_Floats]] | None = None
    again = estimates_again(record, estimator, ((moment.day, moment.seen, True) for moment in shown))
    for moment in shown:
        if moment.day != day:
            day = moment.day
            truth = _truth(record, environment, grid, masks, day)
        model = next(again)
        if model is not None:
            value, uncertainty = (
                [pixel_means(grid, mask, whole[k]) for k, mask in enumerate(masks)]
                for whole in (model.value, model.uncertainty)
            )
            known = value, uncertainty
            del model  # A model of a large farm takes much memory.
        assert known is not None
        yield moment, (truth, *known)


def _truth(
    record: RunRecord,
    environment: Callable[[], Environment],
    grid: MapGrid,
    masks: NDArray[np.bool_],
    day: int,
) -> list[_Floats]:
    """Return the pixel means of a day's truth, from the record or, strip by strip, from the environment."""
    values = kept_truths(record).get(day)
    if values is not None:
        return [pixel_means(grid, mask, values[k]) for k, mask in enumerate(masks)]
    pixels = [np.empty(grid.pixels) for _ in masks]
    columns = max(1, _STRIP_CELLS // grid.pixel)
    width, height = grid.shape
    for first in range(0, grid.pixels[0], columns):
        x = slice(first * grid.pixel, min((first + columns) * grid.pixel, width))
        strip = replace(grid, shape=(x.stop - x.start, height))
        values = environment().window(day, x, slice(None))
        for k, mask in enumerate(masks):
            pixels[k][first : first + columns] = pixel_means(strip, mask[x], values[k])
    return pixels


class _Sheet:
    """Figure with one row per field: panels of truth, estimate and uncertainty, with paths and vehicles."""

    def __init__(self, record: RunRecord, tail_s: float) -> None:
        farm, self._fields = record.farm, tuple(record.fields)
        self._grid = MapGrid.of(farm)
        self._tail_s = tail_s
        self._limits_m = _shown_m(record)
        (left_m, right_m), (bottom_m, top_m) = self._limits_m
        ratio = (top_m - bottom_m) / (right_m - left_m)
        self.figure = Figure(figsize=(7.2, min(0.6 + 2.3 * ratio * len(self._fields), 12.0)), dpi=80)
        FigureCanvasAgg(self.figure)
        panels = self.figure.subplots(len(self._fields), len(_COLUMNS), squeeze=False)
        top = 1.0 - 0.62 / self.figure.get_figheight()
        self.figure.subplots_adjust(left=0.06, right=0.99, bottom=0.02, top=top, wspace=0.04, hspace=0.06)
        self._images: list[list[AxesImage]] = []
        self._lines: list[list[tuple[Line2D, Line2D]]] = []
        self._about = f"{farm.name}: {record.plan.planner or 'mission file'}, {record.estimator}"
        vehicles = sorted({flight.system_id for flight in record.flights})
        for row, field in zip(panels, self._fields, strict=True):
            self._images.append([self._image(axes) for axes in row])
            row[0].set_ylabel(field.title, fontsize=8)
        for axes, name in zip(panels[0], _COLUMNS, strict=True):
            axes.set_title(name, fontsize=9, pad=3)
        self._lines = [[_vehicle(axes, system_id) for system_id in vehicles] for axes in panels.flat]
        self._vehicles = vehicles
        self._has_scale = False

    @property
    def colour_maps(self) -> list[Colormap]:
        """Colour maps of all fields and of the uncertainty."""
        own = {colours.name: colours for colours in map(_colours, self._fields)}
        return [*own.values(), colormaps[_UNCERTAIN]]

    def _image(self, axes: Axes) -> AxesImage:
        cell, pixel = self._grid.cell_size_m, self._grid.pixel
        columns, rows = self._grid.pixels
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_facecolor("#e9e6df")
        # The last column and row of pixels may extend beyond the farm.
        image = axes.imshow(
            np.zeros((rows, columns)),
            origin="lower",
            extent=(0.0, columns * pixel * cell, 0.0, rows * pixel * cell),
            interpolation="nearest",
        )
        axes.set_xlim(*self._limits_m[0])
        axes.set_ylim(*self._limits_m[1])
        return image

    def show(
        self, moment: Moment, truth: list[_Floats], value: list[_Floats], uncertainty: list[_Floats]
    ) -> None:
        """Show a moment in all panels, paths and the title."""
        if not self._has_scale:
            self._has_scale = True
            for k, field in enumerate(self._fields):
                self._scale(field, self._images[k], truth[k], uncertainty[k])
        for k, field in enumerate(self._fields):
            for image, pixels in zip(self._images[k], (truth[k], value[k], uncertainty[k]), strict=True):
                sick = field.kind == "disease" and image is not self._images[k][2]
                image.set_data(np.ma.masked_invalid(1.0 - pixels if sick else pixels).T)
        tracks = {flight.system_id: flight.track for flight in moment.flights}
        for panel, lines in enumerate(self._lines):
            whole = panel % len(_COLUMNS) == len(_COLUMNS) - 1
            since_s = -math.inf if whole else moment.time_s - self._tail_s
            for system_id, (path, place) in zip(self._vehicles, lines, strict=True):
                x, y = _flown(tracks.get(system_id), since_s, moment.time_s)
                path.set_data(x, y)
                place.set_data(x[-1:], y[-1:])
        minutes, seconds = divmod(round(moment.time_s), 60)
        when = f"day {moment.day}, flight {moment.flights[0].flight}, {minutes}:{seconds:02d} min"
        self.figure.suptitle(f"{self._about}\n{when}, {moment.seen} readings", fontsize=9, y=0.995)

    def _scale(self, field: Field, images: list[AxesImage], truth: _Floats, uncertainty: _Floats) -> None:
        top = 1.0
        if field.kind == "disease" and self._grid.pixel > 1:
            top = max(_LARGEST_SHARE, float(np.nanmax(1.0 - truth)))
        for image in images[:2]:
            image.set_cmap(_colours(field))
            image.set_clim(0.0, top)
        images[2].set_cmap(_UNCERTAIN)
        images[2].set_clim(0.0, max(float(np.nanmax(uncertainty, initial=0.0)), 1e-3))


def _shown_m(record: RunRecord) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the shown ranges of x and y (m): the owner's land and all tracks, with a margin."""
    farm = record.farm
    owned = farm.grid().owned
    ends = []
    for axis, cells in enumerate((farm.width_cells, farm.height_cells)):
        along = np.flatnonzero(owned.any(axis=1 - axis))
        least, most = (float(along[0]), float(along[-1] + 1)) if len(along) else (0.0, float(cells))
        tracks = [flight.track.x_m if axis == 0 else flight.track.y_m for flight in record.flights]
        flown = np.concatenate([[least * farm.cell_size_m, most * farm.cell_size_m], *tracks])
        ends.append((float(np.nanmin(flown)), float(np.nanmax(flown)), cells * farm.cell_size_m))
    margin_m = _MARGIN * max(most_m - least_m for least_m, most_m, _ in ends)
    (left, bottom), (right, top) = (
        [max(least_m - margin_m, 0.0) for least_m, _, _ in ends],
        [min(most_m + margin_m, size_m) for _, most_m, size_m in ends],
    )
    return (left, right), (bottom, top)


def _flown(track: Track | None, since_s: float, until_s: float) -> tuple[_Floats, _Floats]:
    """Return x and y of a track from `since_s` to `until_s`; if empty, the last position before `until_s`."""
    if track is None:
        return np.empty(0), np.empty(0)
    until = int(np.searchsorted(track.time_s, until_s, "right"))
    since = max(0, min(int(np.searchsorted(track.time_s, since_s)), until - 1))
    return track.x_m[since:until], track.y_m[since:until]


def _colours(field: Field) -> Colormap:
    if field.kind == "disease":
        return colormaps["YlOrBr"]
    return LinearSegmentedColormap.from_list(field.name, field.colours)


def _vehicle(axes: Axes, system_id: int) -> tuple[Line2D, Line2D]:
    """Return the artists of one vehicle's path and position in a panel."""
    colour = _VEHICLES[(system_id - 1) % len(_VEHICLES)]
    (path,) = axes.plot([], [], color=colour, linewidth=1.0)
    (place,) = axes.plot([], [], color=colour, marker="o", markersize=4, markeredgecolor="white")
    return path, place


_MOST_COLOURS = 255
"""Maximum number of palette colours; index 255 marks pixels that are equal in the previous frame."""
_GREYS = 16
_SHADES = (0.35, 0.7, 1.0)
"""Opacities at which line colours are mixed with white and black, for anti-aliased edges."""


class GifWriter(PillowWriter):
    """Writes GIF frames with one palette for all frames, made from colour maps and line colours."""

    def __init__(self, fps: int, maps: Sequence[Colormap], lines: Sequence[str]) -> None:
        super().__init__(fps=fps)
        self._palette = Image.new("P", (1, 1))
        self._palette.putpalette(palette_of(maps, lines).tobytes())
        self._images: list[Image.Image] = []

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        """Draw the figure and append it as a frame."""
        drawn = BytesIO()
        self.fig.savefig(drawn, format="rgba", dpi=self.dpi, **savefig_kwargs)
        frame = Image.frombuffer("RGBA", self.frame_size, drawn.getvalue(), "raw", "RGBA", 0, 1)
        self._images.append(frame.convert("RGB").quantize(palette=self._palette, dither=Image.Dither.NONE))

    def finish(self) -> None:
        """Write all frames to the file."""
        first, *others = self._images
        first.save(self.outfile, save_all=True, append_images=others, duration=int(1000 / self.fps), loop=0)


def palette_of(maps: Sequence[Colormap], lines: Sequence[str]) -> NDArray[np.uint8]:
    """Return a palette of at most 255 colours, uint8[n, 3]: greys, shades of line colours, colour maps.

    Examples
    --------
    >>> from matplotlib import colormaps
    >>> palette_of([colormaps["viridis"], colormaps["YlOrBr"]], ["#0072b2"]).shape
    (255, 3)
    """
    greys = np.repeat(np.linspace(0.0, 1.0, _GREYS)[:, None], 3, axis=1)
    pure = np.array([to_rgb(line) for line in lines]).reshape(-1, 3)
    shades = [1.0 - part * (1.0 - pure) for part in _SHADES] + [part * pure for part in _SHADES[:-1]]
    fixed = np.concatenate([greys, *shades])
    room = _MOST_COLOURS - len(fixed)
    counts = [room // len(maps) + (k < room % len(maps)) for k in range(len(maps))]
    spread = [colours(np.linspace(0.0, 1.0, n))[:, :3] for colours, n in zip(maps, counts, strict=True)]
    return np.rint(255.0 * np.concatenate([fixed, *spread])).astype(np.uint8)


class _Animation:
    needs_estimate = False  # The animation computes the estimates again.

    def require(self, scenario: Scenario) -> None:
        pass

    def files(self, run: RunRecord) -> list[str]:
        return ["run.gif"] * any(len(flight.track.time_s) for flight in run.flights)

    def write(
        self,
        run: RunRecord,
        path: Path,
        progress: Progress | None,
        *,
        frames: int = _FRAMES,
        estimator: Estimator | None = None,
    ) -> None:
        animate(run, path, frames=frames, estimator=estimator, progress=progress)


ANIMATION = _Animation()
