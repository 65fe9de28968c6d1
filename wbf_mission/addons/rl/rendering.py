"""Render modes of Gymnasium: frames as arrays, and a pygame window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium

from wbf_mission.addons.rl.drawing import Drawing, Scene
from wbf_mission.addons.rl.errors import TrainingError
from wbf_mission.addons.rl.task import SurveyTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
    """Window for at most `FRAMES_A_SECOND`; the first frame opens it. A copy opens another window."""

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
