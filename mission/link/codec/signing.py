"""Message signing: only senders with the key are heard.

Frame and rules after https://mavlink.io/en/guide/message_signing.html: 13 bytes follow the checksum, the
link's number, a time stamp of 48 bits (10 microseconds since 2015-01-01 UTC), and the first 48 bits of the
SHA-256 of the key and all that comes before. A time stamp that is not newer than the last of its sender on
its link is a replay; so is, from a sender that was not heard yet, one that is more than a minute old.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from mission.errors import LinkError

__all__ = ["SETUP_SIGNING", "UNSIGNED", "Signing", "SigningStatistics", "key_from_text"]

KEY_BYTES: Final = 32
SIGNATURE_BYTES: Final = 13
SIGNED: Final = 0x01
SETUP_SIGNING: Final = 256
"""The message that carries a key: never to be logged or passed on."""
UNSIGNED: Final = frozenset({109})
"""Messages that are taken without a signature: RADIO_STATUS, which radios send that have no key."""

_V2 = 0xFD
_EPOCH_S = 1_420_070_400  # 2015-01-01T00:00:00Z in seconds since 1970
_PER_S = 100_000
_OLDEST = 60 * _PER_S
_MOST_STREAMS = 1024
_LATEST = (1 << 48) - 1


def key_from_text(text: str) -> bytes:
    """Return the key of a typed text: 64 hexadecimal digits, or a phrase, hashed as MAVProxy does.

    LinkError if it is empty.

    Examples
    --------
    >>> key_from_text("00" * 32) == bytes(32)
    True
    >>> len(key_from_text("correct horse"))
    32
    """
    text = text.strip()
    if not text:
        msg = "signing key: it is empty; give 64 hexadecimal digits or a phrase"
        raise LinkError(msg)
    if len(text) == 2 * KEY_BYTES:
        try:
            return bytes.fromhex(text)
        except ValueError:
            pass
    return hashlib.sha256(text.encode(errors="surrogateescape")).digest()


@dataclass(slots=True)
class SigningStatistics:
    """Frames with a right signature; those refused for having none, a wrong one, or as replays."""

    good: int = 0
    unsigned: int = 0
    wrong: int = 0
    old: int = 0


class Signing:
    """Signs and checks frames with one key; one object serves all links of a host.

    Parameters
    ----------
    key : bytes, optional
        32 bytes; without, nothing is signed and everything is taken, until `setup`.
    clock : callable, optional
        Seconds since 1970, for the time stamps; without, they count on from ``start_unix_s``.
    start_unix_s : float
        The earliest time stamp.
    link_id : int
        0 to 255; senders that share a key and an address need different ones.
    may_setup : bool
        Whether SETUP_SIGNING may change the key: only where nobody else can listen or send.

    Raises
    ------
    LinkError
        If the key has not 32 bytes, or the link's number is out of range.

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
            msg = f"signing key: {len(key)} bytes; give {KEY_BYTES}"
            raise LinkError(msg)
        if not 0 <= link_id <= 255:
            msg = f"signing: link {link_id} is outside 0..255"
            raise LinkError(msg)
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
        """Whether there is a key."""
        return self._key is not None

    def setup(self, key: bytes, initial_timestamp: int = 0) -> None:
        """Take a new key (all zeros: none) and start no earlier than a time stamp.

        LinkError if the key may not be changed, or has not 32 bytes.
        """
        if not self.may_setup:
            msg = "signing: the key may not be changed over this link"
            raise LinkError(msg)
        if len(key) != KEY_BYTES:
            msg = f"signing key: {len(key)} bytes; give {KEY_BYTES}"
            raise LinkError(msg)
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
        """Return an unsigned MAVLink 2 frame with flag, checksum and signature; without a key as it is."""
        if self._key is None:
            return frame
        self._time = min(self._now() + 1, _LATEST)
        body = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3:-2]
        body += crc(crc_extra, crc(body[1:])).to_bytes(2, "little")
        body += bytes([self.link_id]) + self._time.to_bytes(6, "little")
        return body + self._tag(body)

    def accepts(self, frame: bytes, message_id: int) -> bool:
        """Whether a sound frame may be heard; counts why not."""
        if self._key is None or message_id in UNSIGNED:
            return True
        if frame[0] != _V2 or not frame[2] & SIGNED:
            self.statistics.unsigned += 1
            return False
        if not hmac.compare_digest(self._tag(frame[:-6]), frame[-6:]):
            self.statistics.wrong += 1
            return False
        # Only now is the time stamp to be believed: a forged one must not lock its sender out.
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
