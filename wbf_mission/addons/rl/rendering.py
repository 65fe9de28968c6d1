"""Render modes of Gymnasium: frames as arrays, and a pygame window.

A frame has truth, estimate and uncertainty of one field, paths and remaining budget. A frame is composed from
colour tables, without a plotting library.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from wbf_mission.addons.base.plots import WORST_COLOURS, ramp, rgb
from wbf_mission.addons.rl.catalogue import TrainingError
from wbf_mission.addons.rl.kernels import block_means
from wbf_mission.addons.rl.task import SurveyTask

_PANELS = ("truth", "estimate", "uncertainty")
_SIDE = 300  # Approximate pixels along the longest side of a panel
_NARROWEST = 130  # Minimum width of a panel with its captions
_GAP, _HEAD, _FOOT, _LINE, _TEXT = 12, 58, 48, 17, 12
_BAR = slice(_HEAD - 12, _HEAD - 4)
_PAPER, _INK, _EDGE, _KEPT_OUT, _SPENT = "#ffffff", "#222222", "#8a8378", "#6f6a63", "#dddddd"
_UNCERTAIN = ("#ffffff", "#b7d3e8", "#5b9bcb")
_LAND = {
    "none": "#f4f1ea",
    "pond": "#8fbcd4",
    "strawberry": "#f0d3cf",
    "tomato": "#d5e3c6",
    "wetland": "#9ccfb8",
}
_OTHER_CROP = "#e6dcc0"
_NEIGHBOURS = 0.5  # Colour strength of the neighbours' land
_ROBOTS = ("#d0146e", "#111111", "#009e73", "#0072b2", "#8c6d31", "#7f3fbf")
_TONES = 256

# Pixels are numbers of four bytes, which are fast to copy; the fourth byte is dropped at the end.
_Pixels = Any


class Scene(NamedTuple):
    """Contents of a frame, with k fields on W x H cells."""

    truth: NDArray[np.float32]  # float32[k, W, H]
    value: NDArray[np.float32]  # float32[k, W, H]: the estimate
    uncertainty: NDArray[np.float32]  # float32[k, W, H]
    paths: Sequence[
        NDArray[np.integer]
    ]  # int[n, 2] of each robot: its cells in this flight, the current cell last
    flight: tuple[int, int]  # Day, and number of the flight on that day
    left: tuple[float, float]  # Remaining fractions of the moves of this flight and of the run
    score: float  # Score up to now; NaN before the first score


class Drawing:
    """Draws the frames of a task; all frames have the same `shape`: height, width and 3.

    `field` is drawn, by default the field with the largest weight in the score. Raises TrainingError if the
    task has no such field.
    """

    def __init__(self, task: SurveyTask, field: str | None = None) -> None:
        names, weights = task.fields.names, [one.weight for one in task.fields]
        if field is not None and field not in names:
            raise TrainingError(f"render_field {field!r}: give one of {', '.join(names)}")
        self._k = weights.index(max(weights)) if field is None else names.index(field)
        self._task, self._field = task, list(task.fields)[self._k]
        longest = max(task.grid.shape)
        self._block = -(-longest // _SIDE)
        self._side = _SIDE // -(-longest // self._block)
        self._blocks = tuple(-(-along // self._block) for along in task.grid.shape)
        self._size = wide, high = tuple(along * self._side for along in self._blocks)
        self._slot = slot = max(wide, _NARROWEST)
        self._corners = [(_HEAD + _LINE, _GAP + number * (slot + _GAP)) for number in range(len(_PANELS))]
        width, height = len(_PANELS) * (slot + _GAP) + _GAP, _HEAD + _LINE + high + _FOOT
        # Video codecs require even sizes.
        self.shape = height + height % 2, width + width % 2, 3
        sick = self._field.kind == "disease"
        known = WORST_COLOURS if sick else self._field.colours
        self._tones = _pack(ramp(known, _TONES)), _pack(ramp(_UNCERTAIN, _TONES))
        self._ends = ("lost", "healthy") if sick else ("0", "1"), ("certain", "uncertain")
        self._land, self._scored = self._farm()
        self._over, self._over_colours = self._lines()
        self._base = self._paper()

    def frame(self, scene: Scene) -> NDArray[np.uint8]:
        """Return the frame of a scene, uint8[height, width, 3]."""
        out = self._base.copy()
        wide, high = self._size
        paths = [self._path(path) for path in scene.paths]
        for number, ((top, left), maps) in enumerate(
            zip(self._corners, (scene.truth, scene.value, scene.uncertainty), strict=True)
        ):
            panel = self._spread(self._coloured(maps[self._k], self._tones[number // 2]))
            panel.reshape(-1)[self._over] = self._over_colours
            for robot, (pixels, ring, dot) in enumerate(paths):
                colour = _packed(_ROBOTS[robot % len(_ROBOTS)])
                panel[*pixels] = colour
                panel[*ring] = _packed(_PAPER)
                panel[*dot] = colour
            out[top : top + high, left : left + wide] = panel
        (day, flight), whole = scene.flight, self.shape[1] - 2 * _GAP
        moves = self._task.steps - 1
        texts = [f"day {day}"]
        if len(self._task.flights) > 1:
            texts.append(f"flight {flight}")
        texts.append(f"step {round((1.0 - scene.left[0]) * moves)} of {moves}")
        texts.append(f"budget left {scene.left[1]:.0%}")
        if scene.score <= 0.0:
            texts.append(f"score {scene.score:.4f}")
        self._write(out, _GAP, 8 + _LINE, ", ".join(texts))
        out[_BAR, _GAP : _GAP + round(scene.left[1] * whole)] = _packed(_EDGE)
        # Pillow drops the fourth byte many times faster than NumPy.
        picture = Image.frombuffer("RGBX", self.shape[1::-1], out.data, "raw", "RGBX", 0, 1)
        return np.frombuffer(bytearray(picture.tobytes("raw", "RGB")), np.uint8).reshape(self.shape)

    def _coloured(self, array: NDArray[np.float32], tones: _Pixels) -> _Pixels:
        """Return the colours of blocks: from the map where the field is scored, elsewhere from the land."""
        means = np.empty((1, *self._blocks), np.float32)
        block_means(np.ascontiguousarray(array[None]), self._block, means)
        return np.where(self._scored, tones[(means[0] * (_TONES - 1) + 0.5).astype(np.int64)], self._land)

    def _spread(self, blocks: NDArray[Any]) -> NDArray[Any]:
        """Expand a map from blocks to pixels, rows from the north."""
        return np.repeat(np.repeat(blocks.T[::-1], self._side, axis=0), self._side, axis=1)

    def _farm(self) -> tuple[_Pixels, NDArray[np.bool_]]:
        """Return the land's colour in each block, and whether the field is scored in its first cell."""
        grid, cells = self._task.grid, np.s_[:: self._block, :: self._block]
        land = np.array([rgb(_LAND.get(crop, _OTHER_CROP)) for crop in grid.crops], np.float64)
        colours = np.array([_pack(land), _pack(255.0 - _NEIGHBOURS * (255.0 - land))])
        scored = self._task.fields.masks(grid)[self._k]
        return colours[1 - grid.owned[cells], grid.crop[cells]], scored[cells]

    def _lines(self) -> tuple[NDArray[np.int64], _Pixels]:
        """Return pixel indices and colours of the maps' overlay: crop edges, barred cells, home."""
        land, task = self._spread(self._land), self._task
        edges = np.zeros(land.shape, np.bool_)
        edges[1:] |= land[1:] != land[:-1]
        edges[:, 1:] |= land[:, 1:] != land[:, :-1]
        row, column = np.indices(land.shape)
        barred = (task.grid.owned & ~task.allowed)[:: self._block, :: self._block]
        hatched = self._spread(barred) & ((row + column) % 6 < 2)
        y, x = self._middles(np.array([task.home]))[0]
        away = np.maximum(abs(row - y), abs(column - x))
        reach = min(max(3, self._side // 2), 6)
        home = (away <= reach) & (away > reach - 2)
        over = np.flatnonzero(edges | hatched | home)
        colours = np.where(home, _packed(_INK), np.where(hatched, _packed(_KEPT_OUT), _packed(_EDGE)))
        return over, colours.reshape(-1)[over]

    def _middles(self, cells: NDArray[np.integer]) -> NDArray[np.int64]:
        """Return the centre pixels of cells, int64[n, 2]: row and column within a panel."""
        at = ((cells + 0.5) * (self._side / self._block)).astype(np.int64)
        return np.column_stack((self._size[1] - 1 - at[:, 1], at[:, 0]))

    def _path(self, cells: NDArray[np.integer]) -> tuple[NDArray[np.int64], ...]:
        """Return the pixels of a path, of the ring around the robot, and of the robot, int64[2, n] each."""
        middles = self._middles(cells)
        steps = np.diff(middles, axis=0)[:, None] * (np.arange(self._side) / self._side)[:, None]
        pixels = (middles[:-1, None] + np.rint(steps).astype(np.int64)).reshape(-1, 2)
        if self._side >= 6:
            pixels = np.concatenate([pixels, pixels - (1, 0), pixels - (0, 1)])
        reach = min(max(5, round(0.55 * self._side)), 8)
        around = np.indices((2 * reach + 1, 2 * reach + 1)).reshape(2, -1).T - reach
        away = (around**2).sum(axis=1)
        disks = [middles[-1] + around[away <= least**2 + 1] for least in (reach, reach - 2)]
        within = np.array(self._size[::-1]) - 1
        return tuple(np.clip(one, 0, within).T for one in (pixels, *disks))

    def _paper(self) -> _Pixels:
        """Return the parts that all frames share."""
        out = np.full(self.shape[:2], _packed(_PAPER))
        self._write(out, _GAP, 8, f"{self._task.farm.name}: {self._field.title or self._field.name}")
        out[_BAR, _GAP : self.shape[1] - _GAP] = _packed(_SPENT)
        slot, high = self._slot, self._size[1]
        for number, (top, left) in enumerate(self._corners):
            self._write(out, left, top - _LINE, _PANELS[number])
            first, last = self._ends[number // 2]
            foot, tones = top + high + 8, self._tones[number // 2]
            out[foot : foot + 8, left : left + slot] = tones[np.arange(slot) * _TONES // slot]
            self._write(out, left, foot + 12, first)
            self._write(out, left + slot - int(_font().getlength(last)) - 1, foot + 12, last)
        return out

    def _write(self, out: _Pixels, left: int, top: int, text: str) -> None:
        picture = Image.new("RGB", (self.shape[1] - left, _LINE), _PAPER)
        ImageDraw.Draw(picture).text((0, 0), text, _INK, font=_font())
        out[top : top + _LINE, left:] = _pack(np.asarray(picture))


@functools.cache
def _font() -> Any:
    return ImageFont.load_default(_TEXT)


def _packed(colour: str) -> np.uint32:
    return _pack(np.array(rgb(colour), np.uint8))[()]


def _pack(colours: NDArray[Any]) -> _Pixels:
    """Pack each colour of [..., 3] into one number, uint32[...]."""
    four = np.zeros((*colours.shape[:-1], 4), np.uint8)
    four[..., :3] = colours if colours.dtype == np.uint8 else np.rint(colours)
    return four.view(np.uint32)[..., 0]


FRAMES_A_SECOND = 15
HUMAN, ARRAY = "human", "rgb_array"


class Rendering:
    """Renderer of an environment's runs, in one of `modes` or in no mode; see `Drawing` for `field`.

    Raises TrainingError if `mode` or `field` is unknown, or a library is missing.
    """

    def __init__(
        self, task: SurveyTask, mode: str | None, field: str | None, modes: Sequence[str] = (HUMAN, ARRAY)
    ) -> None:
        if mode is not None and mode not in modes:
            raise TrainingError(f"render_mode {mode!r}: give {' or '.join(modes)}")
        self.mode = mode
        self._drawing = None if mode is None else Drawing(task, field)
        self._window = Window() if mode == HUMAN else None

    def frame(self, scene: Scene) -> NDArray[np.uint8] | None:
        """Return the result of ``render()``: a frame, or None after showing it in the window."""
        if self._drawing is None:
            gymnasium.logger.warn('render() shows nothing: make the environment with render_mode="rgb_array"')
            return None
        frame = self._drawing.frame(scene)
        if self._window is None:
            return frame
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Close the window, if any."""
        if self._window is not None:
            self._window.close()


class Window:
    """Window that shows at most `FRAMES_A_SECOND` frames a second; a copy opens a window of its own."""

    def __init__(self) -> None:
        try:
            import pygame
        except ImportError:
            raise TrainingError(
                "render_mode=\"human\" needs pygame: install with pip install 'wbf-mission[rl]'"
            ) from None
        self._pygame = pygame
        self._screen: Any = None
        self._clock = pygame.time.Clock()

    def __reduce__(self) -> tuple[type[Window], tuple[()]]:
        return Window, ()

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Show a frame, uint8[height, width, 3]; raise TrainingError if no window can be opened."""
        pygame = self._pygame
        if self._screen is None:
            try:
                pygame.display.init()
                self._screen = pygame.display.set_mode(frame.shape[1::-1])
            except pygame.error as error:
                raise TrainingError(
                    f'render_mode="human" cannot open a window: {error}; run it where there is a display,'
                    ' or give render_mode="rgb_array"'
                ) from None
            pygame.display.set_caption("wbf-mission")
        self._screen.blit(pygame.surfarray.make_surface(frame.swapaxes(0, 1)), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(FRAMES_A_SECOND)

    def close(self) -> None:
        """Close the window."""
        if self._screen is not None:
            self._pygame.display.quit()
            self._screen = None
