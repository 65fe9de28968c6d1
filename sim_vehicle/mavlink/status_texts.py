"""STATUSTEXT messages, in chunks where a text is longer than one message holds."""

from __future__ import annotations

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m

__all__ = ["StatusTexts"]

_TEXT_BYTES = 50


class StatusTexts:
    """Makes STATUSTEXTs; long texts are numbered.

    Examples
    --------
    >>> texts = StatusTexts()
    >>> [(part.id, part.chunk_seq) for part in texts.messages(6, "a" * 120)]
    [(1, 0), (1, 1), (1, 2)]
    """

    def __init__(self) -> None:
        self._number = 0

    def messages(self, severity: int, text: str) -> list[Message]:
        """The messages of one text; severity as MAV_SEVERITY."""
        data = text.encode("ascii", "replace")
        if len(data) <= _TEXT_BYTES:
            return [m.MAVLink_statustext_message(int(severity), data)]
        self._number = self._number % 65535 + 1
        # A last chunk that is not full (perhaps empty) tells the reader that the text is complete.
        return [
            m.MAVLink_statustext_message(
                int(severity), data[k * _TEXT_BYTES : (k + 1) * _TEXT_BYTES], self._number, k
            )
            for k in range(len(data) // _TEXT_BYTES + 1)
        ]
