"""ArduCopter 4.7.0-dev (SITL) as it was seen to answer."""

import math

from recorded import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    ERROR,
    GLOBAL_FRAMES,
    HOME,
    INVALID_SEQUENCE,
    NO_SPACE,
    UNSUPPORTED,
    UNSUPPORTED_FRAME,
    Item,
    Recorded,
    item_of,
)

from mission.link.codec.dialect import mavlink as m

PLACED = frozenset({16, 17, 18, 19, 21, 22, 31, 82, 195, 201})
UNPLACED = frozenset({20, 93, 112, 114, 115, 177, 178, 179, 189, 203, 205, 206, 2000, 2001})
TEXTS = {0: "Flight plan received", 1: "Fence received", 2: "Rally points received"}


class Upload:
    """An upload that is going on."""

    def __init__(self, sender, kind, first, last, now_s):
        self.sender, self.kind, self.next, self.last = sender, kind, first, last
        self.received_s = self.asked_s = now_s


class ArduCopter(Recorded):
    """In place, stateless in downloads, home in front of the mission."""

    autopilot = m.MAV_AUTOPILOT_ARDUPILOTMEGA
    # "base_mode 65 (real 81)"
    base_mode = 81
    # "real ArduCopter 64495: PARAM_FLOAT without C_CAST"
    capabilities = 64495
    version = (4, 7, 0)
    # "ArduCopter holds 650 items and says so in a STATUSTEXT"
    capacity = 650
    # "1349" parameters; no word on which: these names are of 4.7.
    parameters = (
        ("FORMAT_VERSION", 120.0, m.MAV_PARAM_TYPE_INT16),
        ("PILOT_TKO_ALT_M", 0.0, m.MAV_PARAM_TYPE_REAL32),
        ("RTL_ALT_M", 15.0, m.MAV_PARAM_TYPE_REAL32),
        *((f"SERVO_{number}", float(number), m.MAV_PARAM_TYPE_INT16) for number in range(1346)),
    )

    def __init__(self):
        super().__init__()
        # "An empty list has count 0, or 1 once home is set"
        self.plans[0] = [self.home_item()]
        self.upload = None

    def home_item(self):
        # "reads back as home (frame 0, AMSL)"
        return Item(0, 16, 1, (0.0,) * 4, HOME[0], HOME[1], HOME[2] / 1000)

    def index_by_name(self, _name):
        # No word; the source copies the index of the request, -1.
        return 65535

    def total(self):
        # "The count includes home, MISSION_CURRENT.total excludes it."
        return max(0, len(self.plans[0]) - 1)

    # -- upload

    def on_mission_count(self, message, sender):
        kind, number = message.mission_type, message.count
        if kind not in self.plans:
            # No word on other types than 255 (UNSUPPORTED).
            self.ack(sender, UNSUPPORTED, kind)
            return
        if self.upload is not None and self.is_foreign(sender):
            # "second ground station or a LIST during upload DENIED"
            self.ack(sender, DENIED, kind)
            return
        # "In the first 2 s after boot an upload gets NO_SPACE ("Only 0 items")"; "count 60000 NO_SPACE"
        room = 0 if self.now_s < 2.0 else self.capacity
        if number > room:
            self.ack(sender, NO_SPACE, kind)
            self.say(f"Only {room} items are supported")
            return
        # "a shorter COUNT truncates at once"
        self.plans[kind] = self.plans[kind][:number]
        self.upload = None
        if number == 0:
            self.ack(sender, ACCEPTED, kind)
            return
        # "ArduPilot restarts the upload"
        self.upload = Upload(sender, kind, 0, number - 1, self.now_s)
        self.request()

    def is_foreign(self, sender):
        return sender != self.upload.sender

    def request(self):
        # "asks with MISSION_REQUEST"
        self.upload.asked_s = self.now_s
        self.send(m.MAVLink_mission_request_message(*self.upload.sender, self.upload.next, self.upload.kind))

    def on_mission_item_int(self, message, sender):
        upload = self.upload
        if upload is None or message.mission_type != upload.kind:
            # No word: an error, by the protocol's text.
            self.ack(sender, ERROR, message.mission_type)
            return
        if sender != upload.sender:
            self.ack(sender, DENIED, upload.kind)
            return
        if message.seq != upload.next:
            # "wrong seq INVALID_SEQUENCE", "and carries on"
            self.ack(sender, INVALID_SEQUENCE, upload.kind)
            return
        result, item = self.judge(message)
        plan = self.plans[upload.kind]
        if result == ACCEPTED and upload.next > len(plan):
            result = ERROR
        if result != ACCEPTED:
            # "item refused: ... mixed"
            self.upload = None
            self.ack(sender, result, upload.kind)
            return
        plan[upload.next : upload.next + 1] = [item]
        upload.received_s = self.now_s
        upload.next += 1
        if upload.next <= upload.last:
            self.request()
            return
        self.upload = None
        self.ack(sender, ACCEPTED, upload.kind)
        self.say(TEXTS[upload.kind], m.MAV_SEVERITY_INFO)

    def judge(self, message):
        """Return the result, and what is stored."""
        item = item_of(message)
        if message.mission_type == 1:
            # "real autopilots drop autocontinue of fence and rally items"; "fence items in frame 3 (real 0)"
            return ACCEPTED, item._replace(frame=0, autocontinue=0, z=0.0)
        if message.mission_type == 2:
            return ACCEPTED, item._replace(frame=3, autocontinue=0)
        if message.seq == 0:
            # "Uploaded item 0 is ignored"
            return ACCEPTED, self.home_item()
        return self.judge_mission_item(item)

    def judge_mission_item(self, item):
        if item.command not in PLACED | UNPLACED:
            return UNSUPPORTED, None
        # "DO_LAND_START in frame 2 is accepted"
        frames = GLOBAL_FRAMES if item.command in PLACED else GLOBAL_FRAMES | {2}
        if item.frame not in frames:
            return UNSUPPORTED_FRAME, None
        if math.isnan(item.params[0]):
            # "p1 NaN INVALID_PARAM1"
            return 6, None
        if item.command in PLACED:
            # "lat/lon out of range INVALID_PARAM5_X/6_Y; alt NaN or 1e6 INVALID_PARAM7"
            if abs(item.x) > 900_000_000:
                return 10, None
            if abs(item.y) > 1_800_000_000:
                return 11, None
            if not abs(item.z) < 83_000:
                return 12, None
        return ACCEPTED, self.stored(item)

    def stored(self, item):
        # "15 bytes/item: hold/turns/radius quantised, autocontinue forced to 1, frame rewritten 0/3/10"
        frame = {0: 0, 5: 0, 3: 3, 6: 3, 10: 10, 11: 10}.get(item.frame, 0)
        one, two, three, _ = item.params
        if item.command == 16:
            # "stores p1 (uint16 s) only on Copter; yaw ignored"
            return Item(frame, 16, 1, (float(int(one)), 0.0, 0.0, 0.0), item.x, item.y, item.z)
        if item.command == 22:
            # "alt only"
            return Item(frame, 22, 1, (0.0,) * 4, 0, 0, item.z)
        if item.command == 19:
            # "LOITER_TIME's NaN or 0 parameters come back as 0 or 1": the direction as 1 or -1
            return Item(frame, 19, 1, (float(int(one)), 0.0, -1.0 if three < 0 else 1.0, 0.0), *item[4:])
        if item.command in PLACED:
            return Item(frame, item.command, 1, (one, two, three, 0.0), item.x, item.y, item.z)
        # "RTL reads back as frame 0"
        kept = {20: (0.0, 0.0, 0.0), 206: (one, 0.0, three)}.get(item.command, (one, two, three))
        return Item(0, item.command, 1, (*kept, 0.0), 0, 0, 0.0)

    def on_mission_write_partial_list(self, message, sender):
        # "Partial write works", "beyond the end ERROR"
        kind, first, last = message.mission_type, message.start_index, message.end_index
        if not 0 <= first <= last <= len(self.plans[kind]):
            self.ack(sender, ERROR, kind)
            return
        self.upload = Upload(sender, kind, first, last, self.now_s)
        self.request()

    def transfer_timers(self):
        upload = self.upload
        if upload is None:
            return
        if self.now_s - upload.received_s > 8.0:
            # "at 8 s ACK OPERATION_CANCELLED" + STATUSTEXT "Mission upload timeout"
            self.upload = None
            self.ack(upload.sender, CANCELLED, upload.kind)
            self.say("Mission upload timeout")
        elif self.now_s - upload.asked_s > 1.0:
            # "re-request each 1 s"
            self.request()

    # -- download; "ArduPilot has no explicit cancel": MISSION_ACK is not looked at

    def on_mission_request_list(self, message, sender):
        kind = message.mission_type
        if self.upload is not None:
            self.ack(sender, DENIED, kind)
        elif kind not in self.plans:
            self.ack(sender, UNSUPPORTED, kind)
        else:
            self.send(m.MAVLink_mission_count_message(*sender, len(self.plans[kind]), kind))

    def on_mission_request_int(self, message, sender):
        kind = message.mission_type
        plan = self.plans[kind]
        if self.upload is not None:
            self.ack(sender, DENIED, kind)
        elif message.seq < len(plan):
            self.send(self.item_message(plan[message.seq], message.seq, kind, sender))
        else:
            # "An out-of-range request returns MISSION_COUNT plus INVALID_SEQUENCE."
            self.send(m.MAVLink_mission_count_message(*sender, len(plan), kind))
            self.ack(sender, INVALID_SEQUENCE, kind)

    def on_mission_clear_all(self, message, sender):
        kind = message.mission_type
        if kind not in self.plans:
            # "clear type 255 UNSUPPORTED"
            self.ack(sender, UNSUPPORTED, kind)
        elif self.upload is not None:
            self.ack(sender, ERROR, kind)
        else:
            # "after a clear 0"
            self.plans[kind] = []
            self.ack(sender, ACCEPTED, kind)

    # -- the current item

    def on_mission_set_current(self, message, _sender):
        if message.seq < len(self.plans[0]):
            self.current = message.seq
            self.send(self.mission_current())

    def choose_by_command(self, number):
        # "DO_SET_MISSION_CURRENT out of range DENIED"
        if number >= len(self.plans[0]):
            return m.MAV_RESULT_DENIED
        self.current = number
        self.send(self.mission_current())
        return m.MAV_RESULT_ACCEPTED

    # -- flight

    def mode_of(self, p):
        return int(p[1])

    def arm(self, value):
        # "41 s simulated from boot to armable (EKF, GPS)"
        if value == 1.0 and self.now_s < 41.0:
            self.say("PreArm: EKF attitude is bad")
            return m.MAV_RESULT_FAILED
        return super().arm(value)

    def take_off(self, altitude_m):
        # "takeoff while disarmed FAILED"
        if not self.armed:
            return m.MAV_RESULT_FAILED
        self.climb_to_m = altitude_m
        return m.MAV_RESULT_ACCEPTED

    def begin_mission(self):
        # "REACHED is sent once per item, also for takeoff and for RTL (at disarm)"; "MISSION_CURRENT(next)
        # about 0.1 s later"; "after disarm CURRENT is seq 0, state 5"
        self.custom_mode, self.climb_to_m = 3, 8.0
        self.mission_state = 3
        last = len(self.plans[0]) - 1
        for number in range(1, last + 1):
            self.later(6.0 * number, lambda number=number: self.reached(number))
            self.later(6.0 * number + 0.1, lambda number=number: self.goes_on(number + 1))
        self.later(6.0 * last, self.disarm)
        self.later(6.0 * last + 0.2, self.is_over)

    def goes_on(self, number):
        self.current = number

    def is_over(self):
        self.current, self.mission_state = 0, 5
