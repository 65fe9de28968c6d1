"""A vehicle on a mission of long legs, and a ground station that changes it in flight."""

import math

from geo.frame import LocalFrame
from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.wire import to_wire_order
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.mavlink import SimVehicle

HOME = GeoPoint(28.05, -82.15, 20.0)
FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m)
HEIGHT_M = 20.0
SPEED_M_S = 7.0
STEP_S = 0.05
"""How often time is told to the vehicle, and its speed looked at."""
ON_THE_WAY_S = 0.25
"""The same on the way to where the mission is changed."""


def wp(x, y, z=HEIGHT_M):
    return MissionItem(16, 3, 0.0, 0.0, 0.0, 0.0, *FRAME.to_wgs84(float(x), float(y)), z)


def do(command, *params):
    return MissionItem(command, 2, *params, *(0.0,) * (4 - len(params)))


def speed(m_s):
    return do(178, 1.0, m_s, -1.0)


def shots(metres):
    return do(206, metres, 0.0, 1.0)


TAKEOFF = MissionItem(22, 3, 0.0, 0.0, 0.0, 0.0, HOME.latitude_deg, HOME.longitude_deg, HEIGHT_M)
RTL = MissionItem(20)
TURN = 5
"""The item that is flown to when the mission is changed, 85 m before it; the leg is 120 m long."""
BASE = (
    TAKEOFF,
    speed(SPEED_M_S),
    shots(5.0),
    wp(0, 30),
    wp(120, 30),
    wp(120, 150),
    wp(240, 150),
    do(177, 6.0, 1.0),
    wp(240, 270),
    RTL,
)


class Flight:
    """A vehicle under an autopilot, told by its ground station; all messages cross the wire."""

    def __init__(self, autopilot, *, dynamics=None, items=BASE):
        name = autopilot.name if dynamics is None else dynamics
        quad = get_vehicle("quad")
        self.vehicle = SimVehicle(
            quad if name == "generic" else with_autopilot(quad, name), HOME, autopilot=autopilot
        )
        self.pilot = self.vehicle.pilot
        self.offset = int(autopilot is ARDUPILOT)
        self.now_s = 0.0
        self.heard = []
        self.speeds = []
        self.wait(0.1)
        if items:
            assert self.upload(items).type == 0

    def _note(self, messages):
        crossed = [FrameReader().feed(FrameWriter(1, 1).encode(message))[0] for message in messages]
        self.heard += [(self.now_s, message) for message in crossed]
        return crossed

    def tell(self, message):
        return self.tell_as(255, 190, message)

    def tell_as(self, system, component, message):
        (arrived,) = FrameReader().feed(FrameWriter(system, component).encode(message))
        return self._note(self.vehicle.receive(arrived, self.now_s))

    def wait(self, seconds, until=None, step_s=STEP_S):
        """Let time pass; the time when a condition came true."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9 and not (until is not None and until()):
            self.now_s = round(self.now_s + step_s, 6)
            self._note(self.vehicle.poll(self.now_s))
            self.speeds.append((self.now_s, self.speed))
        return self.now_s

    def result(self, number, *params):
        params = (*params, *(0.0,) * (7 - len(params)))
        answers = self.tell(m.MAVLink_command_long_message(1, 1, number, 0, *params))
        return next(a.result for a in answers if a.get_type() == "COMMAND_ACK")

    def begin(self, items, kind=0):
        """Send the count of a list; items as they go over the wire."""
        wired = to_wire_order(tuple(items), MissionType(kind), self.vehicle.firmware.profile)
        self.tell(m.MAVLink_mission_count_message(1, 1, len(wired), kind))
        return wired

    def send(self, item, seq, *, current=False):
        return self.tell(wire.item_to_message(item, seq, MissionType.MISSION, (1, 1), current=current))

    def upload(self, items, *, marked=None, every_s=0.0, stop_after=None):
        """Send a list; the ACK. It may go slowly, or stop after so many items on the wire."""
        answers = []
        wired = self.begin(items)
        for seq, item in enumerate(wired[:stop_after]):
            if every_s:
                self.wait(every_s)
            answers += self.send(item, seq, current=marked is not None and seq == marked + self.offset)
        return next((a for a in answers if a.get_type() == "MISSION_ACK"), None)

    def fly(self):
        assert self.result(400, 1.0) == 0
        assert self.result(300) == 0
        return self

    def to_the_change(self, left_m=85.0, seq=TURN):
        """Fly until so many metres before an item."""
        goal = FRAME.from_wgs84(self.pilot.mission.items[seq].x, self.pilot.mission.items[seq].y)

        def is_near(within_m):
            return self.seq == seq and math.dist(self.place[:2], goal) <= within_m

        self.wait(200.0, lambda: is_near(left_m + 5.0), ON_THE_WAY_S)
        self.wait(20.0, lambda: is_near(left_m))
        assert is_near(left_m)
        return self

    def reaches(self, x, y, within_m=3.0, limit_s=200.0):
        """Fly until a position is near; the time then."""
        at_s = self.wait(limit_s, lambda: math.hypot(self.place[0] - x, self.place[1] - y) <= within_m)
        assert math.hypot(self.place[0] - x, self.place[1] - y) <= within_m, self.place
        return at_s

    def slowest(self, since_s):
        return min(v for t, v in self.speeds if t > since_s)

    def dip(self, since_s):
        """How much slower it became than it was then."""
        return max(v for t, v in self.speeds if t <= since_s and t > since_s - 1.5 * STEP_S) - self.slowest(
            since_s
        )

    def asked(self, message_id):
        before = len(self.heard)
        self.result(512, float(message_id))
        return self.heard[before + 1][1]

    @property
    def current(self):
        return self.asked(m.MAVLINK_MSG_ID_MISSION_CURRENT)

    @property
    def seq(self):
        return self.pilot.mission.current_seq

    @property
    def mode(self) -> Mode:
        return self.pilot.mode

    @property
    def place(self):
        return self.pilot.state.position_m

    @property
    def speed(self):
        vx, vy, _ = self.pilot.state.velocity_m_s
        return math.hypot(vx, vy)

    def texts(self):
        return [message.text for _, message in self.heard if message.get_type() == "STATUSTEXT"]

    def of(self, kind, since_s=-1.0):
        return [message for at_s, message in self.heard if message.get_type() == kind and at_s > since_s]
