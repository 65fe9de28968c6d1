"""Stand-ins that answer as real autopilots were seen to answer; the common part of both.

They are written from records of ArduCopter 4.7.0-dev (SITL) and PX4 1.17 (SIH) and from their sources, and
use nothing of the simulated vehicle or of our mission server: only the MAVLink codec. The comments quote the
record. Where it has no word, they do what the protocol's text (https://mavlink.io/en/services/) asks, and say
so.
"""

import contextlib
import struct
import threading
import time
from collections import deque
from typing import ClassVar, NamedTuple

from mission.link import open_link
from mission.link.address import MavlinkEndpoint, memory_pair
from mission.link.codec.dialect import mavlink as m

STEP_S = 0.02
HOME = (-353_632_622, 1_491_652_376, 584_000)  # SITL's: 1e-7 degrees, mm above the sea
ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE, INVALID = range(6)
INVALID_SEQUENCE, DENIED, CANCELLED = 13, 14, 15
GLOBAL_FRAMES = frozenset({0, 3, 5, 6, 10, 11})


class Item(NamedTuple):
    """A stored item, as it reads back."""

    frame: int
    command: int
    autocontinue: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


def item_of(message):
    params = (message.param1, message.param2, message.param3, message.param4)
    return Item(message.frame, message.command, message.autocontinue, params, message.x, message.y, message.z)


class Recorded:
    """What both do: heartbeat, streams, commands, parameters; `hear` and `tick` fill ``out``."""

    autopilot = m.MAV_AUTOPILOT_GENERIC
    base_mode = 1
    capabilities = 0
    version = (1, 0, 0)
    streams_s: ClassVar = {}  # message id: seconds, from the start
    parameters = ()  # (name, value, MAV_PARAM_TYPE)
    capacity = 65535
    other_result = m.MAV_RESULT_UNSUPPORTED

    def __init__(self):
        self.now_s = 0.0
        self.out = []
        self.custom_mode = 0
        self.armed = False
        self.altitude_m = 0.0
        self.climb_to_m = 0.0
        self.flies_mission = False
        self.events = []  # (when, what to do)
        self.current = 0
        self.mission_state = 2
        self.plans = {0: [], 1: [], 2: []}
        self.intervals_s = {0: 1.0, **self.streams_s}
        self.due_s = dict.fromkeys(self.intervals_s, 0.0)
        self.values = {name: [value, kind] for name, value, kind in self.parameters}

    # -- in and out

    def hear(self, message, now_s):
        """Take a message of a ground station; return the answers."""
        self.now_s = now_s
        handle = getattr(self, f"on_{message.get_type().lower()}", None)
        if handle is not None and self.is_for_us(message):
            handle(message, (message.get_srcSystem(), message.get_srcComponent()))
        return self.taken()

    def is_for_us(self, message):
        # "Requests to component 0 or 190 are answered; a foreign system id is ignored." PX4: own, 0, 190.
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, 1) and component in (0, 1, 190)

    def tick(self, now_s):
        """Let time pass; return what goes out by itself."""
        self.now_s = now_s
        for when, action in [event for event in self.events if event[0] <= now_s]:
            self.events.remove((when, action))
            action()
        if self.armed:
            self.altitude_m += min(max(self.climb_to_m - self.altitude_m, -1.0 * STEP_S), 2.0 * STEP_S)
        self.transfer_timers()
        for number, interval_s in self.intervals_s.items():
            if interval_s > 0.0 and now_s >= self.due_s.get(number, 0.0):
                self.due_s[number] = now_s + interval_s
                self.out.append(self.make(number))
        return self.taken()

    def taken(self):
        out, self.out = self.out, []
        return out

    def send(self, *messages):
        self.out += messages

    def say(self, text, severity=m.MAV_SEVERITY_WARNING):
        self.send(m.MAVLink_statustext_message(severity, text.encode()))

    def later(self, seconds, action):
        self.events.append((self.now_s + seconds, action))

    # -- telemetry

    def make(self, number):
        """Return a message by its id, None if there is none."""
        ms = int(self.now_s * 1000)
        x, y, z = HOME
        major, minor, patch = self.version
        landed = m.MAV_LANDED_STATE_IN_AIR if self.altitude_m > 0.1 else m.MAV_LANDED_STATE_ON_GROUND
        state = m.MAV_STATE_ACTIVE if self.armed else m.MAV_STATE_STANDBY
        made = {
            m.MAVLINK_MSG_ID_HEARTBEAT: lambda: m.MAVLink_heartbeat_message(
                m.MAV_TYPE_QUADROTOR,
                self.autopilot,
                self.base_mode | 128 * self.armed,
                self.custom_mode,
                state,
                3,
            ),
            m.MAVLINK_MSG_ID_SYS_STATUS: lambda: m.MAVLink_sys_status_message(
                0x31FF, 0x31FF, 0x31FF, 100, 12600, 0, 100, 0, 0, 0, 0, 0, 0
            ),
            # "GPS fix 3 (real 6)"
            m.MAVLINK_MSG_ID_GPS_RAW_INT: lambda: m.MAVLink_gps_raw_int_message(
                ms * 1000, 6, x, y, z, 121, 200, 0, 0, 10
            ),
            m.MAVLINK_MSG_ID_ATTITUDE: lambda: m.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0),
            m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: lambda: m.MAVLink_global_position_int_message(
                ms, x, y, z + int(1000 * self.altitude_m), int(1000 * self.altitude_m), 0, 0, 0, 0
            ),
            m.MAVLINK_MSG_ID_MISSION_CURRENT: self.mission_current,
            m.MAVLINK_MSG_ID_HOME_POSITION: lambda: m.MAVLink_home_position_message(
                x, y, z, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            ),
            m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: lambda: m.MAVLink_extended_sys_state_message(0, landed),
            m.MAVLINK_MSG_ID_SYSTEM_TIME: lambda: m.MAVLink_system_time_message(1_795_000_000_000_000, ms),
            m.MAVLINK_MSG_ID_AUTOPILOT_VERSION: lambda: m.MAVLink_autopilot_version_message(
                self.capabilities,
                major << 24 | minor << 16 | patch << 8,
                0,
                0,
                0,
                [0] * 8,
                [0] * 8,
                [0] * 8,
                0,
                0,
                0,
            ),
            m.MAVLINK_MSG_ID_PROTOCOL_VERSION: lambda: m.MAVLink_protocol_version_message(
                200, 100, 200, [0] * 8, [0] * 8
            ),
        }.get(number)
        return None if made is None else made()

    def mission_current(self):
        return m.MAVLink_mission_current_message(self.current, self.total(), self.mission_state, 0)

    def total(self):
        raise NotImplementedError

    # "TIMESYNC: tc1==0 is a request => reply tc1=own ns, ts1 echoed"; "answer PING with target 0/0".
    def on_timesync(self, message, _sender):
        if message.tc1 == 0:
            self.send(m.MAVLink_timesync_message(1 + int(self.now_s * 1e9), message.ts1))

    def on_ping(self, message, sender):
        self.send(m.MAVLink_ping_message(message.time_usec, message.seq, *sender))

    # -- commands: "Every COMMAND_LONG/COMMAND_INT gets COMMAND_ACK with target = sender"

    def on_command_long(self, message, sender):
        params = [getattr(message, f"param{number}") for number in range(1, 8)]
        result, *messages = self.command(message.command, params)
        self.send(self.acknowledgement(message.command, result, sender), *messages)

    def on_command_int(self, message, sender):
        params = [message.param1, message.param2, message.param3, message.param4]
        result, *messages = self.command(message.command, [*params, message.x, message.y, message.z])
        self.send(self.acknowledgement(message.command, result, sender), *messages)

    def acknowledgement(self, command, result, sender):
        return m.MAVLink_command_ack_message(command, result, 0, 0, *sender)

    def command(self, command, p):
        """Return the result, and the messages that follow the ACK."""
        yes, no = m.MAV_RESULT_ACCEPTED, m.MAV_RESULT_DENIED
        if command == m.MAV_CMD_REQUEST_MESSAGE:
            # "ACK first, then the message"; "Unsupported id: ACK UNSUPPORTED(3)/DENIED"
            message = self.make(int(p[0]))
            return (no,) if message is None else (yes, message)
        if command == m.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return yes, self.make(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        if command == m.MAV_CMD_GET_HOME_POSITION:
            return yes, self.make(m.MAVLINK_MSG_ID_HOME_POSITION)
        if command == m.MAV_CMD_SET_MESSAGE_INTERVAL:
            default_s = {0: 1.0, **self.streams_s}.get(int(p[0]), -1.0)
            self.intervals_s[int(p[0])] = p[1] / 1e6 if p[1] else default_s
            return (yes,)
        if command == m.MAV_CMD_GET_MESSAGE_INTERVAL:
            interval_us = int(1e6 * self.intervals_s.get(int(p[0]), 0.0))
            return yes, m.MAVLink_message_interval_message(int(p[0]), interval_us)
        if command == m.MAV_CMD_COMPONENT_ARM_DISARM:
            return (self.arm(p[0]),)
        if command == m.MAV_CMD_DO_SET_MODE:
            self.custom_mode = self.mode_of(p)
            return (yes,)
        if command == m.MAV_CMD_NAV_TAKEOFF:
            return (self.take_off(p[6]),)
        if command == m.MAV_CMD_NAV_LAND:
            self.land()
            return (yes,)
        if command == m.MAV_CMD_MISSION_START:
            # Both: "MISSION_START while disarmed ACCEPTED"
            if self.armed:
                self.begin_mission()
            return (yes,)
        if command == m.MAV_CMD_DO_SET_MISSION_CURRENT:
            return (self.choose_by_command(int(p[0])),)
        return (m.MAV_RESULT_UNSUPPORTED,)

    def arm(self, value):
        # No word on other values than 0 and 1: the protocol knows only these.
        if value not in (0.0, 1.0):
            return m.MAV_RESULT_UNSUPPORTED
        self.armed = bool(value)
        return m.MAV_RESULT_ACCEPTED

    def land(self):
        self.climb_to_m = 0.0
        self.later(20.0, self.disarm)

    def disarm(self):
        self.armed, self.altitude_m = False, 0.0

    def reached(self, number):
        self.send(m.MAVLink_mission_item_reached_message(number))

    # -- parameters: every index once, one count; PARAM_SET is answered to everybody by the stored value

    def parameter(self, name, index):
        value, kind = self.values[name]
        return m.MAVLink_param_value_message(name.encode(), value, kind, len(self.values), index)

    def on_param_request_list(self, _message, _sender):
        self.send(*(self.parameter(name, index) for index, name in enumerate(self.values)))

    def on_param_request_read(self, message, _sender):
        name = message.param_id.rstrip("\0")
        if message.param_index >= 0:
            names = list(self.values)
            if message.param_index < len(names):
                self.send(self.parameter(names[message.param_index], message.param_index))
        elif name in self.values:
            self.send(self.parameter(name, self.index_by_name(name)))

    def index_by_name(self, name):
        return list(self.values).index(name)

    def on_param_set(self, message, _sender):
        name = message.param_id.rstrip("\0")
        if name in self.values:
            self.values[name][0] = message.param_value
            self.send(self.parameter(name, self.index_by_name(name)))

    # -- missions

    def ack(self, sender, result, kind, opaque_id=0):
        self.send(m.MAVLink_mission_ack_message(*sender, result, kind, opaque_id))

    def item_message(self, item, number, kind, sender):
        return m.MAVLink_mission_item_int_message(
            *sender,
            number,
            item.frame,
            item.command,
            0,
            item.autocontinue,
            *item.params,
            item.x,
            item.y,
            item.z,
            kind,
        )


def bytewise(value):
    """An integer parameter of PX4: its bytes in the float."""
    return struct.unpack("<f", struct.pack("<i", value))[0]


class Bench:
    """A link to a stand-in on a clock of its own; a message takes ``delay_s`` each way."""

    def __init__(self, autopilot, delay_s=0.0):
        self.autopilot = autopilot
        self.link, vehicle = memory_pair("recorded")
        self.endpoint = MavlinkEndpoint(vehicle, 1, 1)
        self.delay_s = delay_s
        self.now_s = 0.0
        self.up, self.down = deque(), deque()

    def clock(self):
        return self.now_s

    def turn(self):
        """Let the stand-in hear and speak once; tell whether anything has arrived on the ground."""
        self.up += ((self.now_s + self.delay_s, message) for message in self.endpoint.receive())
        answers = []
        while self.up and self.up[0][0] <= self.now_s:
            answers += self.autopilot.hear(self.up.popleft()[1], self.now_s)
        answers += self.autopilot.tick(self.now_s)
        self.down += ((self.now_s + self.delay_s, message) for message in answers)
        arrived = False
        while self.down and self.down[0][0] <= self.now_s:
            self.endpoint.send(self.down.popleft()[1])
            arrived = True
        return arrived

    def wait(self, _link, seconds):
        end_s = self.now_s + seconds
        while not self.turn() and self.now_s < end_s:
            self.now_s += STEP_S


@contextlib.contextmanager
def served(autopilot, clock=time.monotonic):
    """Serve a stand-in on a UDP socket; yields the address for the ground station."""
    link = open_link("udpin:127.0.0.1:0")
    endpoint = MavlinkEndpoint(link, 1, 1)
    stop = threading.Event()

    def run():
        while not stop.is_set():
            now_s = clock()
            answers = [a for x in endpoint.receive() for a in autopilot.hear(x, now_s)]
            for answer in [*answers, *autopilot.tick(now_s)]:
                endpoint.send(answer)
            stop.wait(0.002)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield link.name.replace("udpin", "udpout")
    finally:
        stop.set()
        thread.join(30.0)
        link.close()
