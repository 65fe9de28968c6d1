"""GIF files of figures, in few colours that all frames have in common.

With a palette of its own for each frame, as Pillow makes them, colours flicker and nothing of a frame is that
of the one before: such files are several times as large.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.colors import Colormap, to_rgb
from numpy.typing import NDArray
from PIL import Image

__all__ = ["GifWriter"]

_MOST_COLOURS = 255
"""One of 256 is left for pixels that stay as they were."""
_GREYS = 16
_SHADES = (0.35, 0.7, 1.0)
"""Lines and their smooth edges, on white and on black."""


class GifWriter(PillowWriter):
    """Writes frames of a figure.

    Parameters
    ----------
    fps : int
        Frames a second.
    maps : sequence of Colormap
        Of the figure's images.
    lines : sequence of str
        Colours of its lines.
    """

    def __init__(self, fps: int, maps: Sequence[Colormap], lines: Sequence[str]) -> None:
        super().__init__(fps=fps)
        self._palette = Image.new("P", (1, 1))
        self._palette.putpalette(palette_of(maps, lines).tobytes())
        self._images: list[Image.Image] = []

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        """Take the figure as it is now."""
        drawn = BytesIO()
        self.fig.savefig(drawn, format="rgba", dpi=self.dpi, **savefig_kwargs)
        frame = Image.frombuffer("RGBA", self.frame_size, drawn.getvalue(), "raw", "RGBA", 0, 1)
        self._images.append(frame.convert("RGB").quantize(palette=self._palette, dither=Image.Dither.NONE))

    def finish(self) -> None:
        """Write the file."""
        first, *others = self._images
        first.save(self.outfile, save_all=True, append_images=others, duration=int(1000 / self.fps), loop=0)


def palette_of(maps: Sequence[Colormap], lines: Sequence[str]) -> NDArray[np.uint8]:
    """Return at most 255 colours, uint8[n, 3]: greys, shades of lines, and the rest evenly from the maps.

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
    spread = [one(np.linspace(0.0, 1.0, count))[:, :3] for one, count in zip(maps, counts, strict=True)]
    return np.rint(255.0 * np.concatenate([fixed, *spread])).astype(np.uint8)
