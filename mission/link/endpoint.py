"""A MAVLink sender and receiver on a link."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from mission.link.address import Link
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.link.codec.signing import Signing

Tap = Callable[[bytes, bool], None]


class MavlinkEndpoint:
    """The sender and receiver of a MAVLink component on a link.

    Parameters
    ----------
    wanted : iterable of int, optional
        Ids of the messages that `receive` returns; the others are checked and counted only. None: all.
    tap : callable, optional
        Called with the bytes of each frame and whether it was sent (True) or received (False), for a log.
    signing : Signing, optional
        Signs sent frames, and filters received ones.

    Attributes
    ----------
    reader : FrameReader
        Which messages are `wanted`, and what was heard: `frames`, `sources`, `bad_frames`.
    system_id, component_id : int
        The sender's.

    Examples
    --------
    >>> from mission.link.address import memory_pair
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
        self.system_id, self.component_id = system_id, component_id
        self.codec = mavlink.MAVLink(None, system_id, component_id)
        heard = None if tap is None else lambda frame: tap(frame, False)
        self.reader = FrameReader(wanted, heard, self.codec, signing=signing)
        self._writer = FrameWriter(system_id, component_id, self.codec, signing=signing)
        self._tap = tap

    def send(self, message: Message) -> None:
        """Send one message; LinkError if the link is broken, struct.error if a field is out of range."""
        frame = self._writer.encode(message)
        self.link.send(frame)
        if self._tap is not None:
            self._tap(frame, True)

    def receive(self) -> list[Message]:
        """Return the wanted messages that have arrived, at once; LinkError if the link is broken."""
        return [message for data in self.link.receive() for message in self.reader.feed(data)]

    def close(self) -> None:
        """Close the link."""
        self.link.close()
