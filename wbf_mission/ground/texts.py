"""What the vehicle says in words: STATUSTEXTs, put together where they come in pieces."""

from __future__ import annotations

from mission.link.codec.dialect import mavlink as m

__all__ = ["TextLog"]

_WARNING = 4  # MAV_SEVERITY_WARNING
_MOST_TEXTS = 10_000


class TextLog:
    """The STATUSTEXTs of one vehicle.

    Attributes
    ----------
    texts : list of (float, int, str)
        Time in seconds, severity, text.
    """

    def __init__(self) -> None:
        self.texts: list[tuple[float, int, str]] = []
        self._chunk = (0, -1)

    def on_text(self, message: m.MAVLink_statustext_message, now_s: float) -> None:
        """Take a STATUSTEXT: a new text, or the next piece of the last one."""
        number, chunk = message.id, message.chunk_seq
        if self.texts and number and (number, chunk - 1) == self._chunk:
            began_s, severity, text = self.texts[-1]
            self.texts[-1] = (began_s, severity, text + message.text)
        elif len(self.texts) < _MOST_TEXTS:
            self.texts.append((now_s, message.severity, message.text))
        self._chunk = (number, chunk)

    def note(self, text: str, now_s: float) -> None:
        """Add a warning of the ground station's own."""
        if len(self.texts) < _MOST_TEXTS:
            self.texts.append((now_s, _WARNING, text))

    def last_warning(self, otherwise: str) -> str:
        """The latest warning, which says more than a result code, or `otherwise` when there is none."""
        warnings = [text for _, severity, text in self.texts if severity <= _WARNING]
        return warnings[-1] if warnings else otherwise
