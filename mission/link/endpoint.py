"""A MAVLink sender and receiver on a link."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from mission.link.address import Link
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.frames import FrameReader, FrameWriter, SourceStatistics
from mission.link.codec.signing import Signing

Tap = Callable[[bytes, bool], None]


@dataclass(frozen=True, slots=True)
class LinkStatistics:
    """What has crossed an endpoint so far.

    Parameters
    ----------
    sent, sent_bytes : int
        Frames sent.
    received, received_bytes : int
        Good frames of known messages received (wanted or not), and all bytes that came.
    lost : int
        Frames of all senders missing by their sequence numbers.
    bad_frames, bad_bytes, unknown : int
        See `mission.link.codec.frames.FrameReader`.
    """

    sent: int
    sent_bytes: int
    received: int
    received_bytes: int
    lost: int
    bad_frames: int
    bad_bytes: int
    unknown: int


class MavlinkEndpoint:
    """One MAVLink component's mouth and ear on a link.

    Parameters
    ----------
    wanted : iterable of int, optional
        Ids of the messages that `receive` returns; the others are checked and counted only. None: all.
    tap : callable, optional
        Called with the bytes of each frame and whether it was sent (True) or received (False), for a log.
    signing : Signing, optional
        Signs what is sent; what it does not accept is not received.

    Examples
    --------
    >>> from mission.link.memory import memory_pair
    >>> one, other = memory_pair()
    >>> ground, vehicle = MavlinkEndpoint(one, 255, 190), MavlinkEndpoint(other, 1, 1)
    >>> ground.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    >>> [(m.get_type(), m.get_srcSystem()) for m in vehicle.receive()]
    [('MISSION_REQUEST_LIST', 255)]
    """

    def __init__(
        self,
        link: Link,
        system_id: int,
        component_id: int,
        *,
        wanted: Iterable[int] | None = None,
        tap: Tap | None = None,
        signing: Signing | None = None,
    ) -> None:
        self.link = link
        self.codec = mavlink.MAVLink(None, system_id, component_id)
        self._writer = FrameWriter(system_id, component_id, self.codec, signing=signing)
        self._reader = FrameReader(wanted, codec=self.codec, signing=signing)
        self._sent = 0
        self._sent_bytes = 0
        self._received_bytes = 0
        self._tap: Tap | None = None
        self.tap = tap

    @property
    def system_id(self) -> int:
        """The sender's system id."""
        return int(self.codec.srcSystem)

    @property
    def component_id(self) -> int:
        """The sender's component id."""
        return int(self.codec.srcComponent)

    @property
    def wanted(self) -> frozenset[int] | None:
        """Ids of the messages that `receive` returns; None for all."""
        return self._reader.wanted

    @wanted.setter
    def wanted(self, ids: Iterable[int] | None) -> None:
        self._reader.wanted = None if ids is None else frozenset(ids)

    @property
    def tap(self) -> Tap | None:
        """The callable that sees every frame."""
        return self._tap

    @tap.setter
    def tap(self, tap: Tap | None) -> None:
        self._tap = tap
        self._reader.tap = None if tap is None else lambda frame: tap(frame, False)

    def send(self, message: Message) -> None:
        """Send one message; LinkError if the link is broken, struct.error if a field is out of range."""
        frame = self._writer.encode(message)
        self._sent += 1
        self._sent_bytes += len(frame)
        self.link.send(frame)
        if self._tap is not None:
            self._tap(frame, True)

    def receive(self) -> list[Message]:
        """Return the wanted messages that have arrived, at once; LinkError if the link is broken."""
        messages: list[Message] = []
        for data in self.link.receive():
            self._received_bytes += len(data)
            messages += self._reader.feed(data)
        return messages

    @property
    def sources(self) -> dict[tuple[int, int], SourceStatistics]:
        """What was heard of each (system id, component id)."""
        return self._reader.sources

    @property
    def statistics(self) -> LinkStatistics:
        """What has crossed the endpoint so far."""
        reader = self._reader
        return LinkStatistics(
            sent=self._sent,
            sent_bytes=self._sent_bytes,
            received=reader.frames,
            received_bytes=self._received_bytes,
            lost=sum(source.lost for source in reader.sources.values()),
            bad_frames=reader.bad_frames,
            bad_bytes=reader.bad_bytes,
            unknown=reader.unknown,
        )

    def close(self) -> None:
        """Close the link."""
        self.link.close()
