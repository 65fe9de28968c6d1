"""What who watches vehicles tells of them: simulated ones from within, any others over their link."""

from contextlib import ExitStack, contextmanager
from threading import Thread

import numpy as np
import pytest
from lockstep import sharing
from stand_in import scenario

from mission.ground.link import upload
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader
from mission.model import Command, Mission
from sim_vehicle.airframe.kind import kind_of_type
from sim_vehicle.host.server import Server
from wbf_mission.addons.base.simulator import make_components
from wbf_mission.addons.operate.command import _row
from wbf_mission.addons.operate.control_station import ControlStation
from wbf_mission.addons.operate.telemetry_events import SimulatedWatch, TelemetryEvents
from wbf_mission.addons.operate.watching import FleetWatch
from wbf_mission.events import (
    EventStream,
    Noted,
    Orderable,
    Planned,
    RunBegun,
    Seen,
    VehicleMoved,
    VehicleSaid,
)
from wbf_mission.run.orders import Orders
from wbf_mission.run.plan import plan


class Heard(list):
    """The events of a stream, in their order."""

    def __init__(self):
        self.stream = EventStream()
        self.stream.listen(self.append)

    def of(self, kind):
        return [one for one in list(self) if isinstance(one, kind)]

    def texts(self):
        return [one.text for one in self.of(Noted)]


@contextmanager
def watched_sim(clock, autopilot="px4", *, count=1, speed=10.0, **more):
    """Simulated vehicles with who watches them and gives them orders; yields what is told of them."""
    heard = Heard()
    heard.orders, heard.given = Orders(heard.stream), scenario(autopilot=autopilot, **more)
    heard.made = made = make_components(heard.given, count=count)
    watch, day = SimulatedWatch(made, heard.given.farm.day), heard.given.farm.day
    telemetry = TelemetryEvents(heard.stream, watch, RunBegun("sim", made.farm, None), day=day)
    components = [*made.components, watch, ControlStation(heard.orders)]
    shared = sharing(Server, clock, leads=True)
    with shared(components, ["tcpin:127.0.0.1:0"], speed=speed) as server:
        heard.url, heard.server = server.urls[0].replace("tcpin", "tcp"), server
        heard.watch_until = watching(server, telemetry)
        yield heard


def watching(server, telemetry):
    """Return a function that serves, and publishes events, until a condition holds."""

    def watch_until(condition, what):
        server.run(until=lambda now_s: telemetry.look(now_s) or bool(condition()), limit_s=600.0)
        assert condition(), what

    return watch_until


def uploaded(heard, mission, **options):
    """Send the vehicles a mission."""
    errors = []

    def send():
        try:
            upload(mission, heard.url, **options)
        except Exception as error:
            errors.append(error)

    sending = Thread(target=send)

    def is_over():
        if sending.ident is None:
            sending.start()
        return not sending.is_alive()

    heard.watch_until(is_over, "the upload does not end")
    assert not errors


def ordered(heard, order, value="", *, of=1, confirmed=False):
    """Order something, and watch until it is told what came of it."""
    before = len(heard.texts())
    heard.watch_until(lambda: heard.of(Orderable), "nothing can be ordered")
    assert heard.orders.take([of], order, value, confirmed) == ""

    def told():
        return [one for one in heard.texts()[before:] if "ordered by the page" not in one]

    heard.watch_until(told, f"{order}: nothing came of it")
    return told()


def assert_holds(planned, mission, farm):
    """A vehicle is told to hold a mission, whose waypoints are its path."""
    assert [one.command for one in planned.mission.items] == [one.command for one in mission.items]
    places = [(one.x, one.y) for one in mission.items if one.command == Command.NAV_WAYPOINT]
    path_m = np.column_stack(farm.frame.from_wgs84(*np.array(places).T))
    assert np.allclose(planned.path_m, path_m, atol=0.01)


def test_a_simulated_flight_is_told_from_the_upload_to_the_landing(clock):
    with watched_sim(clock, speed=2.0, fence_m=5.0) as heard:
        mission = plan(heard.given).mission
        uploaded(heard, mission)
        assert ordered(heard, "start", confirmed=True) == ["start is carried out (mode MISSION)"]
        landed = "it never landed"
        heard.watch_until(lambda: any("Disarmed" in one.text for one in heard.of(VehicleSaid)), landed)
    planned = heard.of(Planned)[-1]
    assert_holds(planned, mission, heard.made.farm)
    assert len(planned.mission.fence) == 4
    moved = heard.of(VehicleMoved)
    assert {"LOITER", "MISSION"} <= {one.mode for one in moved}
    assert max(one.height_m for one in moved) > 9.0 and moved[0].height_m < 0.5
    assert max(one.item for one in moved if one.item is not None) == len(mission.items) - 1
    assert moved[-1].battery < moved[0].battery
    # What was seen is what there is to see: this camera makes no errors.
    seen = [one.observations for one in heard.of(Seen)]
    assert 20 < sum(map(len, seen)) <= heard.made.images, "all but those that show no cell of the farm"
    truth = heard.made.environment.values(heard.given.farm.day)
    rows = np.concatenate([one.values for one in seen])
    x, y = (np.concatenate([getattr(one, axis) for one in seen]) for axis in "xy")
    assert np.allclose(rows, truth[:, x, y].T, atol=0.01)
    assert all(0.0 < one.observations.time_s[0] + one.offset_s < heard.server.now_s for one in heard.of(Seen))


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_who_watches_a_simulation_orders_what_a_command_would(clock, autopilot):
    mission, hold = {"px4": ("MISSION", "LOITER"), "ardupilot": ("AUTO", "BRAKE")}[autopilot]
    with watched_sim(clock, autopilot, count=2, speed=4.0) as heard:
        (text,) = ordered(heard, "takeoff", "5", of=1, confirmed=True)
        assert text == "system 1: takeoff 5: the motors stand still; arm first (order arm)"
        for number in (1, 2):
            uploaded(heard, plan(heard.given).mission, system_id=number)
        assert heard.orders.take([1], "start") == "start starts motors: it has to be confirmed"
        assert not heard.made.vehicles[0].pilot.armed
        assert (
            ordered(heard, "start", of=1, confirmed=True)[0]
            == f"vehicle 1: start is carried out (mode {mission})"
        )
        first, second = (one.pilot for one in heard.made.vehicles)
        heard.watch_until(lambda: first.state.position_m[2] > 5.0, "it does not climb")
        assert ordered(heard, "hold", of=1) == [f"vehicle 1: hold is carried out (mode {hold})"]
        assert ordered(heard, "resume", of=1) == [f"vehicle 1: resume is carried out (mode {mission})"]
        (text,) = ordered(heard, "set item", "400", of=1)
        assert text.startswith("system 1: set-item 400: its mission has ")
        assert ordered(heard, "return", of=1) == ["vehicle 1: return is carried out (mode RTL)"]
        assert ordered(heard, "land", of=1) == ["vehicle 1: land is carried out (mode LAND)"]
        assert not second.armed, "nothing was ordered of it"
        assert ordered(heard, "arm", of=2, confirmed=True)[0].startswith("vehicle 2: arm is carried out")
        assert second.armed
        assert ordered(heard, "takeoff", "4", of=2, confirmed=True)[0].startswith("vehicle 2: takeoff is")


def test_who_orders_anew_has_the_order_before_dropped(clock):
    with watched_sim(clock, speed=1.0) as heard:
        uploaded(heard, plan(heard.given).mission)
        ordered(heard, "start", confirmed=True)
        heard.orders.take([1], "set item", "8")
        heard.orders.take([1], "hold")
        (text,) = ordered(heard, "return")
    assert text == "return is carried out (mode RTL)"


def watched(clock, url, heard, *, farm=None, sent=None):
    """Watch what is behind a link, as ``monitor`` does."""
    reader = FrameReader()

    def tap(frame, _now_s):
        for one in reader.feed(frame) if sent is not None else ():
            if one.get_srcSystem() == 255:
                sent.append(one.get_type())

    watch = FleetWatch(lambda text: pytest.fail(text))
    begun = RunBegun("watched", farm, None, simulated=False)
    telemetry = TelemetryEvents(
        heard.stream,
        watch,
        begun,
        named=lambda one: (one.profile.name, kind_of_type(one.monitor.vehicle_type)),
    )
    return sharing(Server, clock, leads=True)([watch], [url], tap=tap), telemetry


def test_a_monitor_tells_of_two_vehicles_and_of_the_plans_that_they_hold(clock, quick_stand_in):
    heard, sent, autopilot = Heard(), [], "ardupilot"
    rows = plan(scenario(autopilot=autopilot, fence_m=5.0)).mission
    other = plan(scenario(autopilot=autopilot, planner="spiral")).mission
    with quick_stand_in(autopilot, count=2, speed=2.0) as (url, made), ExitStack() as stack:
        upload(rows, url, system_id=1)
        server, telemetry = watched(clock, url, heard, farm=made.farm, sent=sent)
        stack.enter_context(server)
        watch_until = watching(server, telemetry)
        watch_until(lambda: heard.of(Planned), "no plan was read")
        (planned,) = heard.of(Planned)
        assert planned.system_id == 1, "the other one holds none"
        assert_holds(planned, rows, made.farm)
        assert len(planned.mission.fence) == len(rows.fence) == 4
        watch_until(lambda: len(heard.of(RunBegun)[-1].vehicles) == 2, "two vehicles")
        assert {one.kind for one in heard.of(RunBegun)[-1].vehicles} == {"multirotor"}
        # Somebody else sends another mission.
        Thread(target=upload, args=(other, url), kwargs={"system_id": 2}).start()
        watch_until(lambda: len(heard.of(Planned)) == 2, "the second plan was not read")
        assert heard.of(Planned)[1].system_id == 2
        assert len(heard.of(Planned)[1].mission.items) == len(other.items)
        Thread(target=upload, args=(Mission(()), url), kwargs={"system_id": 1}).start()
        watch_until(lambda: len(heard.of(Planned)) == 3, "that it holds nothing any more was not told")
        assert heard.of(Planned)[2].mission.items == ()
    moved = heard.of(VehicleMoved)
    assert {one.system_id for one in moved} == {1, 2}
    near = [one for one in moved if np.hypot(one.x_m, one.y_m) < 10.0]
    assert near == moved and all(one.link_quality > 0.9 for one in moved[-2:])
    listens = {"HEARTBEAT", "TIMESYNC", "REQUEST_DATA_STREAM"}
    reads = {"MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK"}
    assert set(sent) <= listens | reads, "it orders nothing"


def from_vehicle(message, number=1):
    message.pack(m.MAVLink(None, number, 1))
    return message


def test_what_a_vehicle_says_that_makes_no_sense_ends_nothing():
    heard, failed, asked = Heard(), [], []
    watch = FleetWatch(failed.append)
    telemetry = TelemetryEvents(
        heard.stream, watch, RunBegun("watched", None, None), named=lambda _one: ("x", "")
    )
    far, none = 2_147_483_647, 65_535
    nonsense = [
        m.MAVLink_heartbeat_message(255, 255, 255, 4_294_967_295, 255, 255),
        m.MAVLink_global_position_int_message(0, far, far, far, -far, 32767, -32768, 32767, none),
        m.MAVLink_mission_current_message(none, none, 255, 255, far, far, far),
        m.MAVLink_mission_count_message(255, 190, none, 0),
        m.MAVLink_mission_item_int_message(255, 190, 0, 255, none, 1, 1, *[float("nan")] * 4, far, far, 9e30),
        m.MAVLink_mission_ack_message(255, 190, 255, 255),
        m.MAVLink_statustext_message(255, b"<b>\xff</b>"),
        m.MAVLink_battery_status_message(0, 0, 0, 0, [0] * 10, 0, -5, -7, 127, 0),
    ]
    for k in range(2000):
        now_s = k / 10.0
        watch.receive(from_vehicle(nonsense[k % len(nonsense)], 1 + k % 3), now_s)
        asked += watch.poll(now_s)
        telemetry._due_wall_s = 0.0
        telemetry.look(now_s)
    assert not heard.of(VehicleMoved) and not heard.of(Planned), "no such place, no such plan"
    assert heard.of(VehicleSaid)
    reads = [one for one in asked if one.get_type().startswith("MISSION")]
    assert reads and len(reads) < 3 * 200 * 2, "it asks again, but not all the time"
    # A vehicle in its place is shown all the same.
    watch.receive(from_vehicle(m.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3), 9), 200.0)
    there = m.MAVLink_global_position_int_message(0, 280000000, -820000000, 20_000, 5_000, 0, 0, 0, 0)
    watch.receive(from_vehicle(there, 9), 200.0)
    telemetry._due_wall_s = 0.0
    telemetry.look(200.0)
    assert [one.system_id for one in heard.of(VehicleMoved)] == [9]
    assert heard.of(RunBegun)[-1].farm is not None


def test_an_old_position_is_not_shown_as_the_present():
    """PX4 sends no position when it has lost its own; its heartbeats go on."""
    watch, shown = FleetWatch(), {}
    there = m.MAVLink_global_position_int_message(0, 280000000, -820000000, 20_000, 30_000, 300, 400, 0, 0)
    watch.receive(from_vehicle(m.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3)), 0.0)
    watch.receive(from_vehicle(there), 0.0)
    for now_s in (1.0, 3.0, 3.1, 600.0):
        watch.receive(from_vehicle(m.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3)), now_s)
        state = watch.vehicles[1].summary(now_s)
        shown[now_s] = [
            state[key] for key in ("latitude_deg", "longitude_deg", "height_m", "ground_speed_m_s")
        ]
        cells = _row(state, now_s, silent=watch.vehicles[1].is_silent(now_s))
        assert cells[6:8] == (["30.0 m", "5.0 m/s"] if now_s <= 3.0 else ["-", "-"])
    assert shown[1.0] == shown[3.0] == [28.0, -82.0, 30.0, 5.0]
    assert shown[3.1] == shown[600.0] == [None] * 4


def test_without_a_farm_the_first_vehicle_is_in_the_middle_of_bare_land(clock, quick_stand_in):
    heard = Heard()
    with quick_stand_in(speed=2.0) as (url, made):
        server, telemetry = watched(clock, url, heard)
        with server:
            watching(server, telemetry)(lambda: heard.of(VehicleMoved), "it is not heard")
    assert heard.of(RunBegun)[0].farm is None
    farm = heard.of(RunBegun)[-1].farm
    assert farm.obstacles == () and farm.width_cells == farm.height_cells == 500
    moved = heard.of(VehicleMoved)[0]
    assert np.hypot(moved.x_m - farm.home_m[0], moved.y_m - farm.home_m[1]) < 1.0
    latitude, longitude = farm.frame.to_wgs84(*farm.home_m)
    assert (latitude, longitude) == pytest.approx(
        (made.vehicle.home.latitude_deg, made.vehicle.home.longitude_deg)
    )
