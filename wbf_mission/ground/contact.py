"""When the vehicle is heard: its silences, and what they leave unknown."""

from __future__ import annotations

import math

__all__ = ["SILENCE_S", "ContactWatch"]

SILENCE_S = 2.0
"""A vehicle that tells nothing for so long is out of reach: it sends several times a second."""


class ContactWatch:
    """Notes when messages of one vehicle arrive.

    Attributes
    ----------
    heard_s : float
        When the last one did; -inf for never.
    silent_s : float
        How long all silences of the flight were together.
    worst_s : float
        How long the longest of them was.
    """

    def __init__(self) -> None:
        self.heard_s = -math.inf
        self.silent_s = self.worst_s = 0.0

    def on_message(self, now_s: float) -> bool:
        """Note a message; tell whether it ends a silence."""
        gap_s, self.heard_s = now_s - self.heard_s, now_s
        if not SILENCE_S < gap_s < math.inf:
            return False
        self.silent_s += gap_s
        self.worst_s = max(self.worst_s, gap_s)
        return True
