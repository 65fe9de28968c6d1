"""MAVLink message signing: only frames signed with the shared key are accepted.

Frame and rules: https://mavlink.io/en/guide/message_signing.html. The 13 signature bytes after the checksum
are the link id, a time stamp of 48 bits (units of 10 microseconds since 2015-01-01 UTC), and the first 48
bits of the SHA-256 of the key and all preceding bytes of the frame. A frame is a replay if its time stamp is
not newer than the last time stamp from the same sender and link id. The first frame of a sender is a replay
if its time stamp is older than one minute.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from mission.errors import LinkError

KEY_BYTES: Final = 32
SIGNATURE_BYTES: Final = 13
SIGNED: Final = 0x01
SETUP_SIGNING: Final = 256
"""Id of SETUP_SIGNING, which carries a key and so must not be logged or forwarded."""
UNSIGNED: Final = frozenset({109})
"""Ids of messages accepted without a signature: RADIO_STATUS, sent by radios, which have no key."""

_V2 = 0xFD
_EPOCH_S = 1_420_070_400  # 2015-01-01T00:00:00Z in seconds since 1970
_PER_S = 100_000
_OLDEST = 60 * _PER_S
_MOST_STREAMS = 1024
_LATEST = (1 << 48) - 1


def key_from_text(text: str) -> bytes:
    """Return the key for 64 hexadecimal digits, or for a passphrase (SHA-256, like MAVProxy).

    Raises LinkError if ``text`` is empty.

    >>> key_from_text("00" * 32) == bytes(32)
    True
    >>> len(key_from_text("correct horse"))
    32
    """
    text = text.strip()
    if not text:
        raise LinkError("signing key: the text is empty; give 64 hexadecimal digits or a passphrase")
    if len(text) == 2 * KEY_BYTES:
        try:
            return bytes.fromhex(text)
        except ValueError:
            pass
    return hashlib.sha256(text.encode(errors="surrogateescape")).digest()


@dataclass(slots=True)
class SigningStatistics:
    """Number of accepted frames, and of frames refused as unsigned, wrongly signed, or replayed (``old``)."""

    good: int = 0
    unsigned: int = 0
    wrong: int = 0
    old: int = 0


class Signing:
    """Signs and checks frames with one key; all links of a host share one object.

    Parameters
    ----------
    key : bytes, optional
        32 bytes. Without a key, frames are sent unsigned and all frames are accepted until `setup`.
    clock : callable, optional
        Unix time (s) for the time stamps. Without a clock, each frame increments the time stamp.
    start_unix_s : float
        Earliest time stamp (Unix time, s).
    link_id : int
        Link id, 0 to 255. Senders with the same key and address need different link ids.
    may_setup : bool
        Whether SETUP_SIGNING may change the key. This is safe only on links that nobody else can use.

    Raises
    ------
    LinkError
        If the key is not 32 bytes long, or ``link_id`` is out of range.

    Examples
    --------
    >>> ours, theirs = Signing(bytes(32)), Signing(bytes(32))
    >>> from mission.link.codec.dialect import mavlink
    >>> from mission.link.codec.frames import FrameReader, FrameWriter
    >>> frame = FrameWriter(1, 1, signing=ours).encode(mavlink.MAVLink_mission_clear_all_message(1, 1))
    >>> len(FrameReader(signing=theirs).feed(frame)), len(FrameReader(signing=theirs).feed(frame))
    (1, 0)
    """

    def __init__(
        self,
        key: bytes | None = None,
        *,
        clock: Callable[[], float] | None = None,
        start_unix_s: float = _EPOCH_S,
        link_id: int = 0,
        may_setup: bool = False,
    ) -> None:
        if key is not None and len(key) != KEY_BYTES:
            raise LinkError(f"signing key: {len(key)} bytes; give {KEY_BYTES} bytes")
        if not 0 <= link_id <= 255:
            raise LinkError(f"signing: link {link_id} is outside 0..255")
        self.may_setup = may_setup
        self.link_id = link_id
        self.statistics = SigningStatistics()
        self._key = None if key is None else bytes(key)
        self._clock = clock
        self._time = max(0, round((start_unix_s - _EPOCH_S) * _PER_S))
        self._heard: dict[tuple[int, int, int], int] = {}

    def __repr__(self) -> str:
        return f"Signing({'a key' if self.active else 'no key'}, link_id={self.link_id})"

    @property
    def active(self) -> bool:
        """Whether a key is set, so that frames are signed and checked."""
        return self._key is not None

    def setup(self, key: bytes, initial_timestamp: int = 0) -> None:
        """Set a new key (all zeros: no key), and set the time stamp to at least ``initial_timestamp``.

        Raises LinkError if the key may not be changed or is not 32 bytes long.
        """
        if not self.may_setup:
            raise LinkError("signing: the key may not be changed over this link")
        if len(key) != KEY_BYTES:
            raise LinkError(f"signing key: {len(key)} bytes; give {KEY_BYTES} bytes")
        self._key = bytes(key) if any(key) else None
        self._time = max(self._time, min(initial_timestamp, _LATEST))
        self._heard.clear()

    def _now(self) -> int:
        if self._clock is not None:
            self._time = max(self._time, round((self._clock() - _EPOCH_S) * _PER_S))
        return self._time

    def _tag(self, signed: bytes) -> bytes:
        assert self._key is not None
        return hashlib.sha256(self._key + signed).digest()[:6]

    def sign(self, frame: bytes, crc_extra: bytes, crc: Callable[..., int]) -> bytes:
        """Return a MAVLink 2 frame with signing flag, new checksum and signature; unchanged without a key."""
        if self._key is None:
            return frame
        self._time = min(self._now() + 1, _LATEST)
        body = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3:-2]
        body += crc(crc_extra, crc(body[1:])).to_bytes(2, "little")
        body += bytes([self.link_id]) + self._time.to_bytes(6, "little")
        return body + self._tag(body)

    def accepts(self, frame: bytes, message_id: int) -> bool:
        """Return whether to accept a frame with a correct checksum; update the statistics."""
        if self._key is None or message_id in UNSIGNED:
            return True
        if frame[0] != _V2 or not frame[2] & SIGNED:
            self.statistics.unsigned += 1
            return False
        if not hmac.compare_digest(self._tag(frame[:-6]), frame[-6:]):
            self.statistics.wrong += 1
            return False
        # Read the time stamp only after the signature is verified: a forged stamp could lock out the sender.
        stamp = int.from_bytes(frame[-12:-6], "little")
        stream = (frame[5], frame[6], frame[-13])
        last = self._heard.get(stream)
        too_old = stamp <= last if last is not None else stamp + _OLDEST < self._now()
        if too_old or (last is None and len(self._heard) >= _MOST_STREAMS):
            self.statistics.old += 1
            return False
        self._heard[stream] = stamp
        self._time = max(self._time, stamp)
        self.statistics.good += 1
        return True
