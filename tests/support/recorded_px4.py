"""PX4 1.17 (SIH) as it was seen to answer."""

import zlib
from typing import ClassVar

from recorded import (
    ACCEPTED,
    CANCELLED,
    ERROR,
    GLOBAL_FRAMES,
    INVALID,
    NO_SPACE,
    UNSUPPORTED,
    UNSUPPORTED_FRAME,
    Recorded,
    bytewise,
    item_of,
)

from mission.link.codec.dialect import mavlink as m

# Commands that are taken in a global frame, and in the frame MISSION.
PLACED = frozenset({16, 17, 19, 21, 22, 31, 195, 201})
UNPLACED = frozenset({20, 93, 112, 114, 177, 178, 179, 189, 197, 203, 205, 206, 2000, 2001})
FENCE = frozenset({5000, 5001, 5002, 5003, 5004})
IDLE, RECEIVING, SENDING = "idle", "receiving", "sending"


class Px4(Recorded):
    """Atomic, strict, one transfer at a time over all ground stations."""

    autopilot = m.MAV_AUTOPILOT_PX4
    # No word on its capabilities: MISSION_FLOAT, MISSION_INT, COMMAND_INT, bytewise, MAVLINK2, fence, rally.
    capabilities = 1 | 4 | 8 | 16 | 8192 | 16384 | 32768
    version = (1, 17, 0)
    # "COUNT>max: ACK NO_SPACE at once"; "UINT16_MAX-1 on POSIX SITL"
    capacity = 65534
    streams_s: ClassVar = {1: 1.0, 24: 0.5, 30: 0.1, 33: 0.1, 42: 1.0, 242: 2.0, 245: 0.5, 2: 1.0}
    # "890" parameters; integers by their bytes
    parameters = (
        ("COM_RC_IN_MODE", bytewise(3), m.MAV_PARAM_TYPE_INT32),
        ("MIS_TAKEOFF_ALT", 2.5, m.MAV_PARAM_TYPE_REAL32),
        *((f"PWM_MAIN_{number}", bytewise(number), m.MAV_PARAM_TYPE_INT32) for number in range(888)),
    )

    def __init__(self):
        super().__init__()
        self.state = IDLE
        self.partner = None
        self.kind = 0
        self.count = 0
        self.next = 0
        self.new = []
        self.heard_s = self.asked_s = 0.0
        self.last_upload = None  # who, type and sequence of the item that ended it

    def total(self):
        # "total 65535 when empty"
        return len(self.plans[0]) or 65535

    def opaque_id(self, kind):
        # "running CRC32 over frame,command,autocontinue,7 params of every item"
        return zlib.crc32(repr(self.plans[kind]).encode()) if self.plans[kind] else 0

    def on_param_request_list(self, message, sender):
        super().on_param_request_list(message, sender)
        # "_HASH_CHECK" closes the list, without an index
        count = len(self.values)
        self.send(m.MAVLink_param_value_message(b"_HASH_CHECK", 1.0, m.MAV_PARAM_TYPE_UINT32, count, 65535))

    # -- upload

    def on_mission_count(self, message, sender):
        kind, number = message.mission_type, message.count
        if self.state is not IDLE:
            # "accepts while seq 0 has not been received (re-sends REQUEST 0)"
            if self.state is RECEIVING and sender == self.partner and self.next == 0 and self.count:
                self.request()
                return
            # "While busy every COUNT (any type, any ground station) gets ERROR."
            self.ack(sender, ERROR, kind)
            self.say("WPM: REJ. CMD: Busy")
            return
        if kind not in self.plans:
            # "Unknown mission_type in COUNT: PX4 ACK INVALID(5)."
            self.ack(sender, INVALID, kind)
            return
        if number > self.capacity:
            self.ack(sender, NO_SPACE, kind)
            return
        self.state, self.partner, self.kind = RECEIVING, sender, kind
        self.count, self.next, self.new = number, 0, []
        self.heard_s = self.now_s
        if number == 0:
            # "After a COUNT of 0 later COUNTs got ERROR until the timeout."
            self.plans[kind] = []
            self.ack(sender, ACCEPTED, kind)
            return
        self.request()

    def request(self):
        # "Asks with MISSION_REQUEST_INT"
        self.asked_s = self.now_s
        self.send(m.MAVLink_mission_request_int_message(*self.partner, self.next, self.kind))

    def on_mission_item_int(self, message, sender):
        if self.state is not RECEIVING:
            if self.last_upload == (sender, message.mission_type, message.seq):
                # "PX4 re-sends ACK ACCEPTED with the same opaque_id"
                self.ack(sender, ACCEPTED, message.mission_type, self.opaque_id(message.mission_type))
                return
            # "ITEM when idle and not a duplicate: PX4 ACK ERROR + STATUSTEXT"
            self.ack(sender, ERROR, message.mission_type)
            self.say("WPM: REJ. WP item: no transfer in progress")
            return
        if sender != self.partner:
            # "ITEM from a foreign partner: STATUSTEXT only"
            self.say("WPM: REJ. WP item: partner ID mismatch")
            return
        self.heard_s = self.now_s
        if message.mission_type != self.kind:
            # "mission_type of an item differing from the transfer: PX4 ACK ERROR, stay in state."
            self.ack(sender, ERROR, self.kind)
            return
        if not self.is_wanted(message.seq):
            # "PX4 silently ignores"
            return
        result, item = self.judge(item_of(message))
        if result != ACCEPTED:
            # "PX4 rejects whole upload"; "UNSUPPORTED; old list"
            self.state = IDLE
            self.ack(sender, result, self.kind)
            return
        self.keep(message.seq, item)
        self.next += 1
        if self.next < self.count:
            self.request()
            return
        self.state = IDLE
        self.last_upload = sender, self.kind, message.seq
        self.plans[self.kind] = self.new
        self.ack(sender, ACCEPTED, self.kind, self.opaque_id(self.kind))

    def keep(self, _number, item):
        self.new.append(item)

    def is_wanted(self, number):
        return number == self.next

    def judge(self, item):
        """Return the result, and what is stored."""
        if self.kind:
            # "fence polygon item with vertex_count<3 => ERROR"
            if item.command in (5001, 5002) and item.params[0] < 3:
                return ERROR, None
            # "real autopilots drop autocontinue of fence and rally items"
            return ACCEPTED, self.integer_frame(item._replace(autocontinue=0))
        if item.command in FENCE or item.command == 5100:
            # "fence/rally command inside type 0 => ERROR"
            return ERROR, None
        if item.frame not in (0, 2, 3, 5, 6):
            # "local and terrain frames UNSUPPORTED_FRAME"
            return UNSUPPORTED_FRAME, None
        # "RTL in frame 3 UNSUPPORTED, in frame 2 accepted; waypoint in frame 2 UNSUPPORTED"
        if item.command not in (UNPLACED if item.frame == 2 else PLACED):
            return UNSUPPORTED, None
        # "not range-checked: lat 95, lon 190, NaN altitude and 1e6 are ACCEPTED"
        one, two, _, four = item.params
        if item.command == 16:
            # "all but p3"; "param4 NaN is kept"
            item = item._replace(params=(one, two, 0.0, four))
        elif item.command == 22:
            # "yaw only kept"
            item = item._replace(params=(0.0, 0.0, 0.0, four))
        return ACCEPTED, self.integer_frame(item)

    @staticmethod
    def integer_frame(item):
        # "frame 3 reads back as 6"
        return (
            item._replace(frame={0: 5, 3: 6}.get(item.frame, item.frame))
            if item.frame in GLOBAL_FRAMES
            else item
        )

    def on_mission_write_partial_list(self, message, sender):
        # "Partial write ERROR"
        self.ack(sender, ERROR, message.mission_type)

    def transfer_timers(self):
        if self.state is IDLE:
            return
        if self.now_s - self.heard_s > 5.0:
            # "after 5 s STATUSTEXT "Operation timeout", no ACK"
            self.state = IDLE
            self.say("Operation timeout")
        elif self.state is RECEIVING and self.count and self.now_s - self.asked_s > 0.25:
            # "re-request each 250 ms"
            self.request()

    # -- download

    def on_mission_request_list(self, message, sender):
        kind = message.mission_type
        if self.state is RECEIVING:
            # "LIST during an upload: PX4 STATUSTEXT only"
            self.say("WPM: REJ. REQUEST LIST: Busy")
            return
        if kind not in self.plans:
            self.ack(sender, INVALID, kind)
            return
        # "A new LIST while sending restarts it"
        number = len(self.plans[kind])
        self.state = SENDING if number else IDLE
        self.partner, self.kind, self.next, self.heard_s = sender, kind, 0, self.now_s
        self.send(m.MAVLink_mission_count_message(*sender, number, kind, self.opaque_id(kind)))

    def on_mission_request_int(self, message, sender):
        if self.state is not SENDING or sender != self.partner or message.mission_type != self.kind:
            self.say("WPM: REJ. WP REQUEST")
            return
        self.heard_s = self.now_s
        plan, number = self.plans[self.kind], message.seq
        if number >= len(plan):
            # "out-of-range request silent"
            return
        # "PX4 tolerates re-request of i-1, errors (ACK ERROR + STATUSTEXT) on jumps."
        if number not in (self.next, self.next - 1):
            self.state = IDLE
            self.ack(sender, ERROR, self.kind)
            self.say("WPM: REJ. WP CMD: Req. WP was unexpected")
            return
        self.next = number + 1
        self.send(self.item_message(plan[number], number, self.kind, sender))

    def on_mission_ack(self, message, sender):
        # "OPERATION_CANCELLED(15) from the client at any point returns PX4 to idle silently"
        if sender == self.partner and (self.state is SENDING or message.type == CANCELLED):
            self.state = IDLE

    def on_mission_clear_all(self, message, sender):
        if self.state is not IDLE:
            # "busy: PX4 STATUSTEXT, no ACK"
            self.say("WPM: REJ. CLEAR: Busy")
            return
        # "types 0,1,2,255(ALL) -> ACK ACCEPTED to the sender"
        for kind in self.plans if message.mission_type == 255 else (message.mission_type,):
            self.plans[kind] = []
        self.ack(sender, ACCEPTED, message.mission_type)

    # -- the current item

    def on_mission_set_current(self, message, _sender):
        if message.seq < len(self.plans[0]):
            # "CURRENT lags 0.1 to 1 s"
            self.later(0.5, lambda: self.choose(message.seq))
        else:
            self.say("WPM: WP CURR CMD: Not in list")

    def choose(self, number):
        self.current = number
        self.send(self.mission_current())

    def choose_by_command(self, _number):
        # "DO_SET_MISSION_CURRENT UNSUPPORTED"
        return m.MAV_RESULT_UNSUPPORTED

    # -- flight

    def mode_of(self, p):
        return int(p[2]) << 24 | int(p[1]) << 16

    def take_off(self, altitude_m):
        # "Disarmed takeoff and MISSION_START ACCEPTED though nothing flies"; the altitude is above the sea
        if self.armed:
            self.climb_to_m = altitude_m - 584.0
        return m.MAV_RESULT_ACCEPTED

    def begin_mission(self):
        # "REACHED is repeated at about 1 Hz"; "the last waypoint before an RTL item reports only the RTL item
        # as reached"
        self.custom_mode, self.climb_to_m = 0x04040000, 8.0
        self.mission_state = 3
        last = len(self.plans[0]) - 1
        for number in (*range(last - 1), last):
            for again in range(11):
                self.later(6.0 * (number + 1) + again, lambda number=number: self.reached(number))
            self.later(6.0 * (number + 1) + 0.5, lambda number=number: self.choose(number))
        self.later(6.0 * (last + 1), self.disarm)
