"""MAVLink sender and receiver of one component on a link."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from mission.link.address import Link
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.link.codec.signing import Signing

Tap = Callable[[bytes, bool], None]


class MavlinkEndpoint:
    """MAVLink sender and receiver of one component on a link.

    Parameters
    ----------
    wanted : iterable of int, optional
        Message ids that `receive` returns; None returns all. Other messages are only checked and counted.
    tap : callable, optional
        Called for each frame with the bytes and True if the frame was sent, False if received.
    signing : Signing, optional
        Signs sent frames and checks the signatures of received frames.

    Attributes
    ----------
    reader : FrameReader
        Decoder of received frames; holds ``wanted`` and the counters ``frames``, ``sources``, ``bad_frames``.
    system_id, component_id : int
        System and component id of sent messages.

    Examples
    --------
    >>> from mission.link.address import memory_pair
    >>> ground_link, vehicle_link = memory_pair()
    >>> ground, vehicle = MavlinkEndpoint(ground_link, 255, 190), MavlinkEndpoint(vehicle_link, 1, 1)
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
        """Send one message; raise LinkError if the link failed, struct.error if a field is out of range."""
        frame = self._writer.encode(message)
        self.link.send(frame)
        if self._tap is not None:
            self._tap(frame, True)

    def receive(self) -> list[Message]:
        """Return the wanted messages that have arrived; raise LinkError if the link failed."""
        return [message for data in self.link.receive() for message in self.reader.feed(data)]

    def close(self) -> None:
        """Close the link."""
        self.link.close()
