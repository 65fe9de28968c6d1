"""The calibration of the gyroscopes as PX4 tells of it, for ground stations that wait for the texts.

Source: PX4 ``calibration_messages.h`` and ``gyro_calibration.cpp``. A vehicle that stands still has
nothing to find out, so that only the time passes.
"""

from __future__ import annotations

from sim_vehicle.component import NEVER

__all__ = ["GyroCalibration"]

_STEP_S = 0.25
_TEXTS = (
    "[cal] calibration started: 2 gyro",
    *(f"[cal] progress <{share}>" for share in range(0, 100, 10)),
    "[cal] calibration done: gyro",
)


class GyroCalibration:
    """Tells of a calibration, text by text.

    Examples
    --------
    >>> calibration = GyroCalibration()
    >>> calibration.begin(5.0)
    >>> calibration.poll(5.0)
    ['[cal] calibration started: 2 gyro']
    >>> calibration.poll(5.1)
    []
    """

    def __init__(self) -> None:
        self._left: list[str] = []
        self._due_s = NEVER

    def begin(self, now_s: float) -> None:
        """Begin; one that runs begins anew."""
        self._left = list(_TEXTS)
        self._due_s = now_s

    def poll(self, now_s: float) -> list[str]:
        """Return what is to be said until now."""
        said = []
        while self._due_s <= now_s:
            said.append(self._left.pop(0))
            self._due_s = self._due_s + _STEP_S if self._left else NEVER
        return said

    def next_deadline(self) -> float:
        """When the next text is due."""
        return self._due_s
