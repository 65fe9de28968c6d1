"""A mission that is changed in flight, over good, bad, dead links and by ground computers that die."""

import math
import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import live_changes
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given
from hypothesis import strategies as st
from live_changes import FRAME, HEIGHT_M, HOME, LANDS_SOON, SameEverywhere, degrees, keys
from sweeps import sweep

from geo.farms import get_farm
from mission import outcome
from mission.autopilots import ARDUPILOT, PX4
from mission.autopilots.profile import NeededParameter
from mission.errors import MissionError
from mission.ground.change import ChangeOutcome, ChangeRequest, FailsafeGuard
from mission.ground.change_aside import AsideChange, Leg
from mission.ground.change_whole import WholeListChange
from mission.ground.contact import Contact
from mission.ground.items import revised_mission
from mission.ground.orders import NotFlyingError
from mission.ground.station import GroundStation
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Mission, MissionItem, MissionType
from mission.outcome import Outcome
from mission.transfer import DownloadComplete, MissionServer
from sensors.camera.leaf_camera import LeafCamera
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot, with_autopilot
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.host.simulation import Impairment, Simulation
from sim_vehicle.mavlink import SimVehicle

IMAGES_M = 4.0
# Guided and dead for good, a real ArduCopter hovers: so long may the ground take at most on a good link.
LONGEST_ASIDE_S = 12.0
OLD = [(0.0, 20.0), (60.0, 20.0), (60.0, 35.0), (0.0, 35.0), (0.0, 50.0), (60.0, 50.0)]
NEW = [(40.0, 70.0), (-20.0, 70.0), (-20.0, 30.0)]
AUTOPILOTS = ["px4", "ardupilot"]


def planned(points=OLD):
    return live_changes.planned(points, IMAGES_M, radius_m=1.0)


class Far:
    """The ground station behind a link that may be dead for a while, or on a computer that dies."""

    wanted = None

    def __init__(self, station, dead=(math.inf, math.inf)):
        self.station, self.dead = station, dead
        self.swallows = ()
        self.system_id, self.component_id = station.system_id, station.component_id

    def is_dead(self, now_s):
        return self.dead[0] <= now_s < self.dead[1]

    def receive(self, message, now_s):
        return [] if self.is_dead(now_s) else self._sent(self.station.receive(message, now_s))

    def poll(self, now_s):
        out = self.station.poll(now_s)
        return [] if self.is_dead(now_s) else self._sent(out)

    def next_deadline(self):
        return self.station.next_deadline()

    def _sent(self, messages):
        return [one for one in messages if one.get_type() not in self.swallows]


class Images:
    """Hears where images are taken."""

    system_id, component_id = 200, 1
    wanted = frozenset({m.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED})

    def __init__(self):
        self.found = {}

    def receive(self, message, now_s):
        self.found[message.image_index] = (now_s, *FRAME.from_wgs84(message.lat / 1e7, message.lon / 1e7))
        return []

    def poll(self, now_s):
        return []

    def next_deadline(self):
        return math.inf


class Flight:
    """One flight whose mission is changed; the vehicle itself is looked at after every step."""

    def __init__(self, autopilot, change=None, when=None, impairment=None, dead=None, forever=False):
        spec = with_autopilot(get_vehicle("quad"), autopilot, LANDS_SOON[autopilot])
        self.vehicle = SimVehicle(spec, HOME, autopilot=get_autopilot(autopilot))
        self.station = GroundStation(planned())
        self.far = Far(self.station)
        self.images = Images()
        farm = get_farm("miniberry-10")
        camera = LeafCameraComponent(LeafCamera(SameEverywhere(), farm.grid().shape, 1), farm)
        self.simulation = Simulation(
            [self.vehicle, self.far, camera, self.images],
            impairment=impairment,
            remote=[self.far] if impairment else (),
        )
        self.new = None
        self.asked_s = None
        self.modes = []
        self.track = []
        self.lists = set()
        self.outbox = []
        self._change, self._when, self._dead, self._forever = change, when, dead, forever

    def fly(self, limit_s=600.0):
        receive = self.far.receive

        def receive_and_ask(message, now_s):
            return receive(message, now_s) + self._ask(now_s)

        self.far.receive = receive_and_ask
        self.reason = self.simulation.run(until=self._look, limit_s=limit_s)
        return self

    def _ask(self, now_s):
        station = self.station
        if self._change is None or self.asked_s is not None or station.phase is not outcome.Phase.FLIGHT:
            return []
        state = station.vehicle_state
        if state.item is None or not self._when(state, now_s - station.started_s):
            return []
        self.asked_s = now_s
        if self._dead is not None:
            begin_s = now_s + self._dead[0]
            self.far.dead = (begin_s, math.inf if self._forever else begin_s + self._dead[1])
        self.new, resume_at = self._change(station.mission, state.item)
        return station.change(self.new, resume_at, now_s)

    def _look(self, now_s):
        pilot = self.vehicle.pilot
        if not self.modes or self.modes[-1][1] is not pilot.mode:
            self.modes.append((now_s, pilot.mode))
        if not self.track or now_s - self.track[-1][0] >= 0.1:
            self.track.append((now_s, *pilot.state.position_m))
        if pilot.armed and pilot.mode is Mode.MISSION:
            self.lists.add(tuple((item.command, item.x, item.y) for item in pilot.mission.items))
        if self._forever and self.far.is_dead(now_s):
            return not pilot.armed
        return self.station.done

    def aside_s(self, until_s):
        """Longest time in another mode than the mission's between the question and a time."""
        ends = [time for time, _ in self.modes[1:]] + [until_s]
        spans = [
            end - begin
            for (begin, mode), end in zip(self.modes, ends, strict=True)
            if mode is Mode.GUIDED and begin >= self.asked_s
        ]
        return max(spans, default=0.0)

    def misses(self, points):
        """The greatest of the least distances between the track and points, metres."""
        track = np.array(self.track)[:, 1:3]
        return max(
            (float(np.hypot(*(track - point).T).min()) for point in np.array(points).reshape(-1, 2)),
            default=0.0,
        )

    def spacing_m(self):
        """Flown lengths from image to image while the mission's camera was to take them."""
        track = np.array(self.track)
        way = np.concatenate([[0.0], np.hypot(*np.diff(track[:, 1:3], axis=0).T).cumsum()])
        times = np.sort([time for time, _, _ in self.images.found.values()])
        return np.diff(np.interp(times, track[:, 0], way))

    def is_home(self):
        x, y, z = self.vehicle.pilot.state.position_m
        return math.hypot(x, y) < 3.0 and z < 0.2 and not self.vehicle.pilot.armed


def other_path(points):
    def change(held, item):
        return revised_mission(held, item, degrees(points), altitude_m=HEIGHT_M, acceptance_radius_m=1.0)

    return change


def at_item(item, after_s=2.0):
    begun = []

    def when(state, _):
        if state.item == item and not begun:
            begun.append(state.heard_s)
        return bool(begun) and state.heard_s - begun[0] >= after_s

    return when


@cache
def changed(autopilot):
    """A flight over a good link whose mission is changed on its way to item 5."""
    return Flight(autopilot, other_path(NEW), at_item(5), Impairment(delay_s=0.05)).fly()


def check_safe(flight):
    """No mixture is ever flown, and it comes home by the old mission or the new one."""
    assert flight.lists <= {keys(planned()), keys(flight.new)} if flight.new else {keys(planned())}
    assert flight.is_home(), (flight.modes, flight.station.changes, flight.reason)


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_another_path_is_flown_from_where_the_vehicle_is(autopilot):
    flight = changed(autopilot)
    [record] = flight.station.changes
    assert record.outcome is ChangeOutcome.DONE
    assert flight.station.outcome is Outcome.COMPLETED
    assert flight.station.mission.items == flight.new.items
    check_safe(flight)
    assert flight.misses(NEW) < 2.5
    assert flight.misses(OLD[3:]) > 10.0
    assert record.asked_s <= record.sent_s <= record.turned_s <= record.in_effect_s <= record.ended_s
    assert record.acknowledged_s <= record.in_effect_s
    assert 0.0 <= record.delay_s <= 1.0
    aside_s = flight.aside_s(flight.simulation.now_s)
    assert 0.0 < aside_s < LONGEST_ASIDE_S if autopilot == "ardupilot" else aside_s == 0.0


@pytest.mark.parametrize(("path", "climbs"), [([], False), (NEW, True)], ids=["home", "climb"])
def test_a_change_leads_home_at_once_and_one_asked_for_in_the_climb_is_flown_after_it(path, climbs):
    when = (lambda state, _s: state.height_m > 3.0) if climbs else at_item(5)
    flight = Flight("ardupilot", other_path(path), when).fly()
    assert flight.station.changes[0].outcome is ChangeOutcome.DONE
    assert flight.station.outcome is Outcome.COMPLETED
    check_safe(flight)
    assert flight.misses(path) < 2.5 and flight.misses(OLD[3:]) > 10.0


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_mission_that_must_not_be_flown_is_refused_before_anything_is_sent(autopilot):
    flight = Flight(autopilot).fly(limit_s=20.0)
    station = flight.station
    home, there = MissionItem(Command.NAV_RETURN_TO_LAUNCH), MissionItem.waypoint(28.0502, -82.15, 12.0)
    bad = [
        ((there,), 0, "leads home"),
        ((there, home), 2, "item 3, at which to resume, does not exist"),
        ((MissionItem(178), there, home), 0, "has no position"),
        ((there, MissionItem.waypoint(30.0, -82.15, 12.0), home), 0, "from home"),
        ((there, MissionItem.waypoint(28.05, -82.15, 20_000.0), home), 0, "20000 m high"),
    ]
    for items, resume_at, text in bad:
        with pytest.raises(MissionError, match=text):
            station.change(Mission(items, HOME), resume_at, flight.simulation.now_s)
    assert not station.changing
    assert station.changes == []
    station.change(Mission((there, home), HOME), 0, flight.simulation.now_s)
    with pytest.raises(NotFlyingError, match="is being changed"):
        station.change(Mission((there, home), HOME), 0, flight.simulation.now_s)


def test_on_the_ground_nothing_is_changed():
    with pytest.raises(NotFlyingError, match="waiting for the vehicle"):
        GroundStation(planned()).change(planned(), 2, 0.0)


@pytest.mark.parametrize(("autopilot", "begin_s"), [("ardupilot", 0.05), ("px4", 0.4), ("ardupilot", 1.2)])
def test_a_ground_computer_that_dies_at_any_step_costs_the_change_and_not_the_vehicle(autopilot, begin_s):
    impairment = Impairment(delay_s=0.05, seed=3)
    flight = Flight(autopilot, other_path(NEW), at_item(5), impairment, dead=(begin_s, 0.0), forever=True)
    flight.fly()
    check_safe(flight)
    # Out of its mission nobody keeps it: it comes home, instead of hovering there.
    if Mode.GUIDED in [mode for _, mode in flight.modes]:
        assert flight.modes[-1][1] in (Mode.RTL, Mode.MISSION)


def test_an_arducopter_gets_a_failsafe_before_it_leaves_its_mission():
    flight = Flight("ardupilot", other_path(NEW), at_item(5), Impairment(delay_s=0.05)).fly()
    assert [one.outcome for one in flight.station.changes] == [ChangeOutcome.DONE]
    parameters = flight.vehicle.pilot.parameters
    assert parameters.link_action == 1 and parameters.failsafe_options == 16 | 2
    assert parameters.link_timeout_s == 90.0
    told = " ".join(flight.station.parameters_set)
    assert "FS_OPTIONS was 16, is set to 18" in told and "FS_GCS_ENABLE was 0, is set to 1" in told


def test_a_failsafe_that_is_not_told_of_or_stays_as_it_is_is_missing():
    enable = NeededParameter("FS_GCS_ENABLE", good=frozenset({1}), value=1)
    needed = enable, NeededParameter("FS_OPTIONS", bits=2)

    def told(name, value):
        return m.MAVLink_param_value_message(name.encode(), value, 2, 70, 3)

    silent = FailsafeGuard(needed, Contact((1, 1), is_real=False), [])
    asked = [len(silent.poll(float(now_s))) for now_s in range(6)]
    assert asked == [2, 2, 2, 2, 0, 0] and "could not be read" in silent.refused and not silent.ready
    stubborn = FailsafeGuard(needed, Contact((1, 1), is_real=False), [])
    stubborn.begin(0.0)
    assert stubborn.receive(told("FS_OPTIONS", 18.0)) == []
    [setting] = stubborn.receive(told("FS_GCS_ENABLE", 0.0))
    assert setting.get_type() == "PARAM_SET" and setting.param_value == 1.0
    assert stubborn.receive(told("FS_GCS_ENABLE", 0.0)) == [] and "stays 0, but must be 1" in stubborn.refused
    # Asked for again with the next change.
    [again] = stubborn.begin(10.0)
    assert again.get_type() == "PARAM_REQUEST_READ" and not stubborn.refused
    assert stubborn.receive(told("OTHER", 1.0)) == stubborn.receive(told("FS_GCS_ENABLE", math.nan)) == []
    assert stubborn.receive(told("FS_GCS_ENABLE", 1.0)) == [] and stubborn.ready


def test_without_that_failsafe_it_does_not_leave_its_mission():
    flight = Flight("ardupilot", other_path(NEW), at_item(5), Impairment(delay_s=0.02))
    flight.far.swallows = ("PARAM_SET",)
    flight.fly()
    [record] = flight.station.changes
    assert record.outcome is ChangeOutcome.REFUSED and "would not come home: FS_GCS_ENABLE" in record.text
    assert flight.vehicle.pilot.parameters.link_action == 0
    assert Mode.GUIDED not in [mode for _, mode in flight.modes]
    assert flight.station.outcome is Outcome.COMPLETED
    check_safe(flight)
    assert flight.misses(OLD) < 2.5


def test_a_mission_goes_on_without_its_ground_station_when_the_options_say_so():
    impairment = Impairment(delay_s=0.02)
    flight = Flight(
        "ardupilot", other_path(NEW), at_item(5), impairment, dead=(20.0, 0.0), forever=True
    ).fly()
    assert [one.outcome for one in flight.station.changes] == [ChangeOutcome.DONE]
    assert flight.modes[-1][1] is Mode.MISSION and flight.misses(NEW) < 2.5
    check_safe(flight)


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_refused_item_leaves_the_old_mission(autopilot):
    def change(held, item):
        new, resume_at = other_path(NEW)(held, item)
        # Autopilots know the take-off of a VTOL; this vehicle is none.
        unknown = MissionItem(84, 3, x=28.05, y=-82.15, z=10.0)
        return replace(
            new, items=(*new.items[: resume_at + 1], unknown, *new.items[resume_at + 1 :])
        ), resume_at

    flight = Flight(autopilot, change, at_item(5), Impairment(delay_s=0.02)).fly()
    [record] = flight.station.changes
    wanted = ChangeOutcome.REFUSED if autopilot == "px4" else ChangeOutcome.ROLLED_BACK
    assert record.outcome is wanted
    assert re.search("support|rejected", record.text)
    assert record.acknowledged_s is None
    assert flight.station.outcome is Outcome.COMPLETED
    assert flight.lists == {keys(planned())}
    check_safe(flight)
    assert flight.misses(OLD) < 2.5


@pytest.mark.parametrize(("after", "autopilot"), [(1, "ardupilot"), (5, "px4")])
def test_a_change_that_the_vehicle_gives_up_is_sent_anew(autopilot, after):
    """The link is dead for as long as the vehicle waits for an item; the operator reads one line of it."""
    abort_s = {"px4": PX4, "ardupilot": ARDUPILOT}[autopilot].abort_s
    flight = Flight(autopilot, other_path(NEW), at_item(5), Impairment(delay_s=0.05, seed=3))
    send, poll, sent = flight.far._sent, flight.far.poll, []

    def send_until_it_breaks(messages):
        if flight.asked_s is not None:
            sent.extend(one for one in messages if one.get_type() == "MISSION_ITEM_INT")
        return send(messages)

    def poll_and_break(now_s):
        if len(sent) >= after and math.isinf(flight.far.dead[0]):
            flight.far.dead = (now_s, now_s + abort_s + 1.0)
        return poll(now_s)

    flight.far._sent, flight.far.poll = send_until_it_breaks, poll_and_break
    flight.fly()
    check_safe(flight)
    [record] = flight.station.changes
    assert record.outcome is ChangeOutcome.DONE, record
    assert flight.misses(NEW) < 2.5
    told = [text for _, _, text in flight.station.texts if text.startswith("change not accepted")]
    if autopilot == "px4":
        assert told == ["change not accepted, the vehicle flies the old path, trying again"]
    else:
        assert len(told) <= 1
    assert record.retries >= max(1, len(told))
    assert sum(one.retries for one in flight.station.all_transfers) >= record.retries


def test_a_mission_that_cannot_be_put_back_is_flown_home_from():
    flight = Flight("ardupilot", other_path(NEW), at_item(5), Impairment(delay_s=0.02))
    ask = flight._ask

    def ask_and_cut(now_s):
        out = ask(now_s)
        if flight.asked_s is not None:
            flight.far.swallows = ("MISSION_ITEM_INT",)
        return out

    flight._ask = ask_and_cut
    flight.fly()
    [record] = flight.station.changes
    assert record.outcome is ChangeOutcome.GIVEN_UP
    assert "could not be restored: the vehicle returns home" in record.text
    assert flight.lists == {keys(planned())}
    assert flight.modes[-1][1] is Mode.RTL
    check_safe(flight)


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_the_camera_neither_stops_nor_takes_an_image_twice(autopilot):
    flight = changed(autopilot)
    assert flight.station.changes[0].outcome is ChangeOutcome.DONE
    spacing_m = flight.spacing_m()
    assert len(spacing_m) > 20
    assert spacing_m.max() < 1.6 * IMAGES_M
    assert spacing_m.min() > 0.6 * IMAGES_M


# A flight takes too long for shrinking.
@sweep(
    few=3,
    many=40,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
@given(
    autopilot=st.sampled_from(AUTOPILOTS),
    moment_s=st.floats(1.0, 110.0),
    impairment=st.builds(
        Impairment,
        loss=st.floats(0.0, 0.3),
        duplication=st.floats(0.0, 0.3),
        delay_s=st.floats(0.0, 0.4),
        jitter_s=st.floats(0.0, 0.3),
        seed=st.integers(0, 1000),
    ),
    dead=st.none() | st.tuples(st.floats(0.0, 6.0), st.floats(1.0, 60.0)),
    path=st.sampled_from([OLD[3:], NEW]),
)
def test_at_any_moment_over_any_link_one_whole_mission_is_flown_to_its_end(
    autopilot, moment_s, impairment, dead, path
):
    flight = Flight(autopilot, other_path(path), lambda _, s: s >= moment_s, impairment, dead=dead)
    flight.fly(limit_s=900.0)
    # Over the worst links no mission comes up before the flight.
    assume(flight.asked_s is not None)
    check_safe(flight)
    assert flight.station.outcome in (Outcome.COMPLETED, Outcome.FLIGHT_ABORTED, Outcome.LINK_LOST)


class WholeChange:
    """A PX4 in its mission at item 4, and a change that its mission server has taken and told back."""

    def __init__(self, ids=True):
        self.contact, self.session = Contact((1, 1), is_real=False), None
        old = planned()
        self.new, self.resume_at = other_path(NEW)(old, 4)
        self.hear(m.MAVLink_heartbeat_message(2, 12, 129, 4 << 24 | 4 << 16, 4, 3), 0.0)
        self.hear(m.MAVLink_mission_current_message(4, len(old.items), 3, 1), 0.9)
        self.session = WholeListChange(ChangeRequest(old, self.new, 4, self.resume_at, self.contact, 0.1))
        server, queue = MissionServer(1, 1), self.session.start(1.0)
        self.ids = {0}
        while queue:
            message = queue.pop(0)
            message.pack(m.MAVLink(None, 255, 190))
            for reply in server.receive(message, 1.0).messages:
                if hasattr(reply, "opaque_id"):
                    reply.opaque_id *= ids
                    self.ids.add(reply.opaque_id)
                queue += self.hear(reply, 1.0)

    def hear(self, message, now_s):
        message.pack(m.MAVLink(None, 1, 1))
        self.contact.receive(message, now_s)
        return [] if self.session is None else self.session.receive(message, now_s)

    def shows(self, item, now_s, mission_id=None, mode=1):
        told = (item, len(self.new.items), 3, mode, max(self.ids) if mission_id is None else mission_id)
        self.hear(m.MAVLink_mission_current_message(*told), now_s)
        return self.session.done


def test_a_whole_change_is_done_when_the_vehicle_shows_it():
    change = WholeChange()
    marked = change.session._mark
    assert not change.session.done, "what it told before its confirmation proves nothing"
    assert not change.shows(marked, 1.1, mission_id=max(change.ids) + 1), "the id is of another mission"
    assert not change.shows(marked - 1, 1.2), "an item before the one to go on with"
    assert not change.shows(len(change.new.items), 1.3), "an item of the old mission"
    assert not change.shows(marked, 1.4, mode=2), "it has left its mission"
    assert change.shows(marked, 1.5)
    assert change.session.record.outcome is ChangeOutcome.DONE
    assert change.session.record.in_effect_s == 1.5


def test_of_a_vehicle_without_ids_only_what_it_shows_afterwards_counts():
    change = WholeChange(ids=False)
    marked = change.session._mark
    assert change.ids == {0} and marked <= 4 < len(change.new.items), "its item could be of both missions"
    assert not change.session.done
    assert change.shows(marked, 1.1)


@pytest.mark.parametrize(("held", "is_another"), [(planned(), False), (planned(OLD[2:]), True)])
def test_a_mission_that_is_read_back_and_not_the_new_one_ends_the_change(held, is_another):
    session = WholeChange().session
    session._compare(DownloadComplete(MissionType.MISSION, held.items, 0), 2.0)
    assert session.record.outcome is ChangeOutcome.GIVEN_UP
    assert ("the vehicle holds another mission" in session.record.text) is is_another


def test_a_vehicle_that_shows_another_item_is_told_four_times():
    change, told = WholeChange(), []
    assert change.session.poll(10.0) == [], "of a vehicle that is not heard nobody knows how far it is"
    now_s = 10.0
    while not change.session.done:
        now_s += 2.0
        change.shows(change.session._mark - 1, now_s - 0.1)
        told += change.session.poll(now_s)
        assert now_s < 30.0
    assert [one.get_type() for one in told] == ["MISSION_SET_CURRENT"] * 4
    assert change.session.record.outcome is ChangeOutcome.GIVEN_UP
    assert "stays at item" in change.session.record.text
    assert change.session.held == change.new


@pytest.mark.parametrize(
    ("metres", "seconds_an_item", "further"), [(2.0, 1.0, 2), (2.0, 0.5, 1), (2.0, 0.01, 0), (59.0, 1.0, 0)]
)
def test_what_is_passed_while_a_whole_change_is_sent_is_not_flown_back_to(metres, seconds_an_item, further):
    change, old = WholeChange(), planned()
    [(latitude, longitude)] = degrees([(OLD[1][0] - metres, OLD[1][1])])
    place = round(latitude * 1e7), round(longitude * 1e7)
    change.hear(m.MAVLink_global_position_int_message(900, *place, 0, 12_000, 0, 500, 0, 9000), 1.0)
    new, resume_at = other_path(OLD[1:])(old, 4)
    request = ChangeRequest(old, new, 4, resume_at, change.contact, seconds_an_item)
    session = WholeListChange(request)
    session.start(1.0)
    assert session._target == resume_at + further


def test_what_was_passed_while_it_was_sent_before_is_not_flown_back_to():
    change, old = WholeChange(), planned()
    new, resume_at = other_path(OLD[1:])(old, 4)
    change.session = WholeListChange(ChangeRequest(old, new, 4, resume_at, change.contact, 0.1))
    change.session.start(1.0)
    assert change.session._next_then() == resume_at
    change.hear(m.MAVLink_mission_current_message(5, len(old.items), 3, 1), 1.1)
    assert change.session._next_then() == resume_at + 1


class Aside:
    """A change aside, message by message, of an ArduCopter that was in its mission at 9.9 s."""

    def __init__(self):
        self.contact = Contact((1, 1))
        self.contact.receive(self.beat(3), 9.9)
        position = (0, 280_500_000, -821_500_000, 0, 12_000, 0, 0, 0, 0)
        self.contact.receive(m.MAVLink_global_position_int_message(*position), 9.9)
        self.change = AsideChange(ChangeRequest(planned(), planned(NEW), 5, 2, self.contact, 0.1))

    def beat(self, mode):
        return m.MAVLink_heartbeat_message(2, m.MAV_AUTOPILOT_ARDUPILOTMEGA, 0x81, mode, 4, 3)

    def hears(self, message, now_s):
        message.pack(m.MAVLink(None, 1, 1))
        self.contact.receive(message, now_s)
        return self.change.receive(message, now_s)


@pytest.mark.parametrize(("after_s", "orders"), [(5.0, [m.MAV_CMD_DO_SET_MODE]), (60.0, [])])
def test_the_guided_mode_long_after_a_change_is_another_operators(after_s, orders):
    aside = Aside()
    assert [message.command for message in aside.change.start(10.0)] == [m.MAV_CMD_DO_REPOSITION]
    assert aside.hears(aside.beat(5), 11.0) == []
    assert aside.change.record.outcome is ChangeOutcome.GIVEN_UP
    found = aside.hears(aside.beat(4), 11.0 + after_s)
    assert [message.command for message in found] == orders
    assert not found or found[0].param2 == 5, "the mode that the pilot had chosen"


@pytest.mark.parametrize(("mode", "orders"), [(4, 1), (6, 0)])
def test_a_vehicle_that_is_silent_is_not_ordered_back_into_its_mission(mode, orders):
    """A pilot may have taken it over (mode 6); a vehicle that is still in guided mode is ordered back."""
    aside = Aside()
    change = aside.change
    change.start(10.0)
    assert [one.command for one in change.poll(13.0)] == [m.MAV_CMD_DO_REPOSITION], "tried a few times"
    aside.hears(aside.beat(4), 13.0)
    (back,) = aside.hears(m.MAVLink_command_ack_message(m.MAV_CMD_DO_REPOSITION, m.MAV_RESULT_DENIED), 13.1)
    assert back.command == m.MAV_CMD_DO_SET_MODE
    assert [one.command for one in change.poll(14.2)] == [back.command], "its last HEARTBEAT is fresh"
    assert not any(change.poll(second) for second in range(16, 60))
    assert aside.hears(aside.beat(mode), 60.0) == []
    assert [one.command for one in change.poll(61.5)] == [back.command] * orders
    assert change.done is (not orders)


def test_a_target_over_the_date_line_is_near_and_neared():
    state = SimpleNamespace(latitude_deg=0.0, longitude_deg=179.9999, velocity_m_s=(5.0, 0.0, 0.0))
    plan = Mission((MissionItem.waypoint(0.0, -179.9999, 10.0),))
    leg = Leg(plan, 0, SimpleNamespace(state=state), None)
    assert leg.distance_m == pytest.approx(22.2, abs=0.1) and leg.nearing_m_s == pytest.approx(5.0)
