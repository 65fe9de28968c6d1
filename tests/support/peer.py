"""A ground station that talks to a simulated vehicle at a time of its own, and servers in their threads."""

import threading
from contextlib import contextmanager

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.model import GeoPoint, MissionType
from mission.transfer import wire
from mission.transfer.wire import to_wire_order
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.host.simulation import StopReason
from sim_vehicle.mavlink import SimVehicle

GROUND = FrameWriter(255, 190)
HOME = GeoPoint(28.05, -82.15, 20.0)


def crossed(message, writer=GROUND):
    """The message as its receiver decodes it."""
    (arrived,) = FrameReader().feed(writer.encode(message))
    return arrived


class Peer:
    """A vehicle, the ground station that commands it, and what it told."""

    def __init__(self, autopilot="px4", kind="quad", *, home=HOME, spec=None, **options):
        self.autopilot = get_autopilot(autopilot) if isinstance(autopilot, str) else autopilot
        spec = get_vehicle(kind) if spec is None else spec
        self.vehicle = SimVehicle(spec, home, autopilot=self.autopilot, **options)
        self.now_s = 0.0
        self.told = []
        self.times = []
        self.wait(0.0)

    def _note(self, messages):
        self.told += messages
        self.times += [self.now_s] * len(messages)
        return messages

    def tell(self, message, writer=GROUND):
        answers = self.vehicle.receive(crossed(message, writer), self.now_s)
        return self._note([crossed(answer, FrameWriter(1, 1)) for answer in answers])

    def wait(self, seconds):
        end_s = self.now_s + seconds
        while True:
            self.now_s = min(end_s, max(self.now_s, self.vehicle.next_deadline()))
            self._note(self.vehicle.poll(self.now_s))
            if self.now_s >= end_s:
                return

    def command(self, number, *params, confirmation=0, target=(1, 1)):
        filled = [*params, *[0.0] * (7 - len(params))]
        return self.tell(m.MAVLink_command_long_message(*target, number, confirmation, *filled))

    def result(self, number, *params, **options):
        """MAV_RESULT of a command; None where it is not answered."""
        acks = [a for a in self.command(number, *params, **options) if a.get_type() == "COMMAND_ACK"]
        if not acks:
            return None
        (ack,) = acks
        assert (ack.command, ack.target_system, ack.target_component) == (number, 255, 190)
        return ack.result

    def asked(self, message_id, *params):
        """The answer to REQUEST_MESSAGE; None where there is none."""
        answers = self.command(512, message_id, *params)
        return next((answer for answer in answers if type(answer).id == message_id), None)

    def upload(self, items, kind=0):
        """Send a plan; the MISSION_ACK. Home goes in front of a mission where the autopilot has it there."""
        plan = MissionType(kind)
        wired = to_wire_order(tuple(items), plan, self.vehicle.firmware.profile)
        answers = self.tell(m.MAVLink_mission_count_message(1, 1, len(wired), kind))
        for seq, item in enumerate(wired):
            answers += self.tell(wire.item_to_message(item, seq, plan, (1, 1)))
        return next(answer for answer in answers if answer.get_type() == "MISSION_ACK")

    def of(self, kind):
        return [message for message in self.told if message.get_type() == kind]

    def texts(self):
        return [text.text for text in self.of("STATUSTEXT")]


@contextmanager
def running(server):
    """A server in its own thread; what it raises and that it does not stop are failures."""
    ended = []

    def run():
        try:
            ended.append(server.run())
        except BaseException as error:
            ended.append(error)
            raise

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(30.0)
        assert not thread.is_alive()
        server.close()
    assert ended == [StopReason.STOPPED]
