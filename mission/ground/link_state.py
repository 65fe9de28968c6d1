"""Quality of the link to a vehicle: frame loss, round trip time and silences."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer import RoundTrip

__all__ = ["SILENCE_S", "LinkReport", "LinkState", "SilenceWatch", "milliseconds"]

_WINDOW = 200
_SEQUENCES = 256
_LATE = 128
_FEWEST = 20
_ASK_S = 1.0
_ASK_AGAIN_S = 5.0
_MOST_OPEN = 32


@dataclass(frozen=True, slots=True)
class LinkReport:
    """A link to a vehicle over a whole flight."""

    # frames, lost_frames: frames of the vehicle's autopilot that arrived, and that are missing by their
    # sequence numbers
    frames: int
    lost_frames: int
    round_trip_s: float | None
    # worst_silence_s, silent_s: the longest silence of the flight, and all of them together
    worst_silence_s: float
    silent_s: float

    @property
    def loss(self) -> float:
        """Fraction of the frames that did not arrive."""
        return self.lost_frames / max(self.frames + self.lost_frames, 1)


class LinkState:
    """Counts the frames of a vehicle's autopilot, and asks it for its clock to measure the round trip.

    The clock is asked for with TIMESYNC, whose answer repeats the number of its question: unlike the answer
    to a repeated command it cannot be taken for the answer to another one. PX4 and ArduPilot answer it
    (https://mavlink.io/en/services/timesync.html).
    """

    def __init__(self) -> None:
        self.heard_s = -math.inf  # When its last frame came; -inf before the first
        # frames, lost_frames: how many came, and how many are missing by their sequence numbers
        self.frames = self.lost_frames = 0
        self.round_trip = RoundTrip()
        self._sequence: int | None = None
        self._steps: deque[int] = deque(maxlen=_WINDOW)
        self._open: dict[int, float] = {}
        self._due_s = -math.inf

    @property
    def quality(self) -> float | None:
        """Part of its last 200 frames that arrived, by their sequence numbers; None before there are two."""
        sent = sum(self._steps)
        return len(self._steps) / sent if sent else None

    def receive(self, message: Message, now_s: float) -> None:
        """Take any message of the autopilot."""
        self.heard_s = now_s
        self.frames += 1
        sequence = message.get_seq()
        step = 1 if self._sequence is None else (sequence - self._sequence) % _SEQUENCES
        # A frame that comes late or twice is none that is missing.
        if 0 < step < _LATE:
            self._steps.append(step)
            self.lost_frames += step - 1
            self._sequence = sequence
        if len(self._steps) >= _FEWEST:
            self.round_trip.loss = 1.0 - (self.quality or 1.0)
        if isinstance(message, m.MAVLink_timesync_message) and message.tc1:
            asked_s = self._open.pop(message.ts1, None)
            if asked_s is not None:
                self.round_trip.sample(now_s - asked_s)

    def poll(self, now_s: float) -> list[Message]:
        """Ask for the vehicle's clock when that is due: each second until it answers, then now and then."""
        if now_s < self._due_s or self.heard_s == -math.inf:
            return []
        self._due_s = now_s + (_ASK_S if self.round_trip.seconds is None else _ASK_AGAIN_S)
        number = round(1e9 * now_s) + 1
        self._open[number] = now_s
        while len(self._open) > _MOST_OPEN:
            del self._open[next(iter(self._open))]
        return [m.MAVLink_timesync_message(0, number)]

    def next_deadline(self) -> float:
        """When `poll` has something to do."""
        return math.inf if self.heard_s == -math.inf else self._due_s

    def brief(self) -> str:
        """Return the state in a few words, for a line of many.

        Examples
        --------
        >>> LinkState().brief()
        'link -'
        """
        quality, trip_s = self.quality, self.round_trip.seconds
        heard = "-" if quality is None else f"{quality:.0%}"
        return f"link {heard}" if trip_s is None else f"link {heard}, answers in {milliseconds(trip_s)}"


def milliseconds(seconds: float) -> str:
    """Return a round trip time as text.

    Examples
    --------
    >>> milliseconds(0.0002), milliseconds(0.0474), milliseconds(4.01)
    ('0.2 ms', '47 ms', '4010 ms')
    """
    time_ms = 1000.0 * seconds
    return f"{time_ms:.1f} ms" if time_ms < 10.0 else f"{time_ms:.0f} ms"


SILENCE_S = 2.0
"""A vehicle silent for this long is out of reach: it sends several times a second."""


class SilenceWatch:
    """Measures the silences of a vehicle: total and longest."""

    def __init__(self) -> None:
        self.heard_s = -math.inf
        self.silent_s = self.worst_s = 0.0

    def on_message(self, now_s: float) -> bool:
        """Note a message; return whether it ends a silence."""
        gap_s, self.heard_s = now_s - self.heard_s, now_s
        if not SILENCE_S < gap_s < math.inf:
            return False
        self.silent_s += gap_s
        self.worst_s = max(self.worst_s, gap_s)
        return True
