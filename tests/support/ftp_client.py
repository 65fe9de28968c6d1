"""Who reads and writes files over MAVLink FTP."""

import struct

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from wbf_mission.addons.files.file_tree import FtpError
from wbf_mission.addons.files.ftp import ACK, MOST_DATA, NAK, Operation, Packet


class Client:
    """Asks a server, as the ground station that it says it is."""

    def __init__(self, server, source=255):
        self.server = server
        self.sequence = 0
        self.writer = FrameWriter(source, 190)

    def send(self, packet, now_s=0.0):
        message = m.MAVLink_file_transfer_protocol_message(0, 1, 1, list(packet.payload()))
        (crossed,) = FrameReader().feed(self.writer.encode(message))
        replies = [one for one in self.server.receive(crossed, now_s) if one.get_type() == message.get_type()]
        return [Packet.parse(bytes(reply.payload)) for reply in replies]

    def ask(self, operation, data=b"", *, session=0, offset=0, size=-1):
        self.sequence = (self.sequence + 1) & 0xFFFF
        if isinstance(data, str):
            data = data.encode()
        (reply,) = self.send(Packet(self.sequence, session, operation, size, offset=offset, data=data))
        assert reply.sequence == (self.sequence + 1) & 0xFFFF
        assert (reply.session, reply.request) == (session, operation)
        if reply.operation == NAK:
            return FtpError(reply.data[0])
        assert reply.operation == ACK
        return reply.data

    def read(self, path, size=MOST_DATA):
        opened = self.ask(Operation.OPEN_TO_READ, path)
        if isinstance(opened, FtpError):
            return opened
        data = b""
        while not isinstance(part := self.ask(Operation.READ, offset=len(data), size=size), FtpError):
            data += part
        assert part is FtpError.END_OF_FILE
        (self.told_size,) = struct.unpack("<I", opened)
        self.ask(Operation.TERMINATE)
        return data

    def write(self, path, data):
        assert self.ask(Operation.CREATE, path) == b""
        for start in range(0, len(data), 200):
            assert self.ask(Operation.WRITE, data[start : start + 200], offset=start) == b""
        return self.ask(Operation.TERMINATE)
