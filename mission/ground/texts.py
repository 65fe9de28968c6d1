"""Log of a vehicle's STATUSTEXTs; the chunks of a long text are joined."""

from __future__ import annotations

import math
import re
from itertools import takewhile

from mission.link.codec.dialect import mavlink as m

WHOLE_S = 0.5
"""Time after its first chunk at which a text of several chunks counts as complete (s)."""

_WARNING = 4  # MAV_SEVERITY_WARNING
_MOST_TEXTS = 10_000
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")
# With these texts, PX4 and ArduCopter report a refusal without its reason.
_NO_REASON = re.compile(
    r"Arming denied: Resolve system health failures first|Switching to .* is currently not available"
    r"|Mode change to .* failed: init failed"
)


class TextLog:
    """STATUSTEXTs of one vehicle: time (s), MAV_SEVERITY, text; the oldest of very many are dropped."""

    def __init__(self) -> None:
        self.texts: list[tuple[float, int, str]] = []
        self._dropped = 0
        self._chunk = (0, -1)  # Id and number of the last chunk.
        self._joined = 0  # Number of the text that the next chunk continues.

    @property
    def count(self) -> int:
        """Number of all texts, including dropped texts."""
        return self._dropped + len(self.texts)

    def since(self, number: int) -> list[tuple[float, int, str]]:
        """Return the texts from ``number`` on, counted from 0, without dropped texts."""
        return self.texts[max(0, number - self._dropped) :]

    def begun_until(self, told: int, until_s: float = math.inf) -> tuple[list[tuple[float, int, str]], int]:
        """Return the texts from number ``told`` on that began at ``until_s`` or earlier, and the next number.

        >>> log = TextLog()
        >>> log.note("Armed", 0.0), log.note("Takeoff", 1.0), log.note("Landed", 4.0)
        (None, None, None)
        >>> log.begun_until(1, 3.0)
        ([(1.0, 4, 'Takeoff')], 2)
        """
        said = list(takewhile(lambda text: text[0] <= until_s, self.since(told)))
        return said, max(told, self._dropped) + len(said)

    def on_text(self, message: m.MAVLink_statustext_message, now_s: float) -> None:
        """Handle a STATUSTEXT: a new text, or the next chunk of the last text."""
        number, chunk = message.id, message.chunk_seq
        # PX4 appends a tab to texts that are also sent as events.
        said = _CONTROL.sub("", message.text)
        if not (number and (number, chunk - 1) == self._chunk):
            self.note(said, now_s, message.severity)
            self._joined = self.count - 1
        elif (index := self._joined - self._dropped) >= 0:
            began_s, severity, text = self.texts[index]
            self.texts[index] = (began_s, severity, text + said)
        self._chunk = (number, chunk)

    def note(self, text: str, now_s: float, severity: int = _WARNING) -> None:
        """Add a text of the ground station; only texts of warning severity or above can explain a failure."""
        if len(self.texts) >= _MOST_TEXTS:
            self._dropped += _MOST_TEXTS // 2
            del self.texts[: _MOST_TEXTS // 2]
        self.texts.append((now_s, severity, text))

    def warnings(self, since: int = 0) -> list[str]:
        """Return the distinct texts of at least warning severity, from number ``since`` on."""
        warnings = (text for _, severity, text in self.since(since) if severity <= _WARNING)
        return list(dict.fromkeys(warnings))

    def explain(self, failure: str, since: int = 0) -> str:
        """Return a failure text, followed by the vehicle's warnings from number ``since`` on, if any.

        >>> log = TextLog()
        >>> log.note("WPM: REJ. CMD: Busy", 0.0)
        >>> log.explain("upload of the mission was refused")
        'upload of the mission was refused; the vehicle says: WPM: REJ. CMD: Busy'
        """
        said = "; ".join(self.warnings(since))
        return f"{failure}; the vehicle says: {said}" if said else failure

    def last_warning(self, otherwise: str, since: int = 0) -> str:
        """Return the latest warning from number ``since`` on, or ``otherwise`` if there is none.

        A text without a reason counts only if it is alone, because it arrives after the text with the reason.

        >>> log = TextLog()
        >>> log.note("Mission rejected: no take-off", 0.0)
        >>> log.note("Switching to Mission is currently not available", 1.0)
        >>> log.last_warning("refused")
        'Mission rejected: no take-off'
        """
        warnings = [text for _, severity, text in self.since(since) if severity <= _WARNING]
        reasons = [text for text in warnings if not _NO_REASON.fullmatch(text)]
        return (reasons or warnings or [otherwise])[-1]
