"""Quality of the link to a vehicle: frame loss, round trip time and interruptions."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer import RoundTrip

_WINDOW = 200  # Number of frames from which the quality is computed.
_SEQUENCES = 256
_LATE = 128  # A frame whose sequence number steps by this or more is late.
_OVERTAKEN = 16  # Greatest number of frames that overtake a frame; after a reboot, steps back are larger.
_MODE_AND_ITEM = (m.MAVLink_heartbeat_message, m.MAVLink_mission_current_message)
_FEWEST = 20  # Number of frames needed for a first estimate of the loss.
_ASK_S = 1.0
_ASK_AGAIN_S = 5.0
_MOST_OPEN = 32  # Greatest number of unanswered requests that are remembered.


SILENCE_S = 2.0
"""Time without a message after which a vehicle counts as out of reach (s).

Vehicles send several messages per second.
"""


@dataclass(frozen=True, slots=True)
class LinkReport:
    """Link quality over a whole flight."""

    frames: int  # Frames received from the autopilot.
    lost_frames: int  # Frames missing by sequence number.
    round_trip_s: float | None  # Smoothed round trip time, None if never measured.
    worst_silence_s: float  # Longest time without a message.
    silent_s: float  # Total time of all silences.

    @property
    def loss(self) -> float:
        """Fraction of lost frames."""
        return self.lost_frames / max(self.frames + self.lost_frames, 1)


class LinkState:
    """Frame loss and round trip time of the link to an autopilot.

    The round trip is measured by TIMESYNC (https://mavlink.io/en/services/timesync.html), which PX4 and
    ArduPilot answer. Unlike a COMMAND_ACK, a TIMESYNC answer repeats the time stamp of its request, and so
    identifies the request.
    """

    def __init__(self) -> None:
        self.heard_s = -math.inf  # Time of the last frame, -inf before the first.
        self.frames = self.lost_frames = 0  # Frames received, and frames missing by sequence number.
        self.round_trip = RoundTrip()
        self._sequence: int | None = None
        self._steps: deque[int] = deque(maxlen=_WINDOW)
        self._open: dict[int, float] = {}
        self._due_s = -math.inf

    @property
    def quality(self) -> float | None:
        """Fraction of the frames that arrived, over the last 200 arrivals, or None before the first frame."""
        sent = sum(self._steps)
        return len(self._steps) / sent if sent else None

    def receive(self, message: Message, now_s: float) -> bool:
        """Handle any message of the autopilot; return False for a mode or item that newer frames overtook."""
        gap_s, self.heard_s = now_s - self.heard_s, now_s
        self.frames += 1
        sequence = message.get_seq()
        step = 1 if self._sequence is None else (sequence - self._sequence) % _SEQUENCES
        # A late or repeated frame has a step of 0 or beyond `_LATE`, and is not a loss.
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
        is_overtaken = step >= _SEQUENCES - _OVERTAKEN and gap_s <= SILENCE_S
        return not (is_overtaken and isinstance(message, _MODE_AND_ITEM))

    def poll(self, now_s: float) -> list[Message]:
        """Return the TIMESYNC request if due: each second until the first answer, then every 5 s."""
        if now_s < self._due_s or self.heard_s == -math.inf:
            return []
        self._due_s = now_s + (_ASK_S if self.round_trip.seconds is None else _ASK_AGAIN_S)
        number = round(1e9 * now_s) + 1
        self._open[number] = now_s
        while len(self._open) > _MOST_OPEN:
            del self._open[next(iter(self._open))]
        return [m.MAVLink_timesync_message(0, number)]

    def next_deadline(self) -> float:
        """Return the time of the next TIMESYNC request, infinite before the first frame."""
        return math.inf if self.heard_s == -math.inf else self._due_s

    def brief(self) -> str:
        """Return the link quality and the round trip time as a short text for a status line.

        >>> LinkState().brief()
        'link -'
        """
        quality, trip_s = self.quality, self.round_trip.seconds
        heard = "-" if quality is None else f"{quality:.0%}"
        return f"link {heard}" if trip_s is None else f"link {heard}, answers in {milliseconds(trip_s)}"


def milliseconds(seconds: float) -> str:
    """Return a round trip time as text.

    >>> milliseconds(0.0002), milliseconds(0.0474), milliseconds(4.01)
    ('0.2 ms', '47 ms', '4010 ms')
    """
    time_ms = 1000.0 * seconds
    return f"{time_ms:.1f} ms" if time_ms < 10.0 else f"{time_ms:.0f} ms"


class SilenceWatch:
    """Total and longest time without a message from a vehicle."""

    def __init__(self) -> None:
        self.heard_s = -math.inf
        self.silent_s = self.worst_s = 0.0

    def on_message(self, now_s: float) -> bool:
        """Record a message; return whether it ends a silence longer than `SILENCE_S`."""
        gap_s, self.heard_s = now_s - self.heard_s, now_s
        if not SILENCE_S < gap_s < math.inf:
            return False
        self.silent_s += gap_s
        self.worst_s = max(self.worst_s, gap_s)
        return True
