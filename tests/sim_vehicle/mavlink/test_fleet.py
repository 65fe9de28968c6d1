"""Several vehicles in one process, several ground stations, the same bytes again."""

import itertools
import socket
import time

import pytest
from processes import wait_until

from geo.frame import LocalFrame
from mission.link import MavlinkEndpoint, TlogWriter, open_link
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem
from mission.transfer.driver import TransferDriver
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.errors import VehicleError
from sim_vehicle.host.ports import ServerUrl
from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink.fleet import Fleet, fleet_urls, start_positions
from sim_vehicle.weather.wind import Wind
from tests.support.peer import running

HOME = GeoPoint(28.05, -82.15, 20.0)


def quads(count, **options):
    return Fleet(get_vehicle("quad"), HOME, count, **options)


# Every vehicle tells of itself ten times a second.
SPEED = 10.0


def free_ports(number):
    """Ports that nobody uses now."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(number)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def hear(endpoint, seconds=0.2, systems=frozenset()):
    """What an endpoint hears, saying hello now and then; longer if these systems are not yet among it."""
    heard, began = [], time.monotonic()
    while (waited := time.monotonic() - began) < seconds or (
        waited < 30.0 and not {x.get_srcSystem() for x in heard} >= systems
    ):
        endpoint.send(m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        heard += endpoint.receive()
        time.sleep(0.02)
    return heard


@pytest.mark.parametrize("count", [1, 2, 9, 26, 250])
def test_places_are_apart_and_near(count):
    places = start_positions(HOME, count, 4.0)
    frame = LocalFrame(HOME.latitude_deg, HOME.longitude_deg)
    xy = [frame.from_wgs84(place.latitude_deg, place.longitude_deg) for place in places]
    assert len(places) == count
    assert places[0] == HOME
    assert all(abs(x) < 36.0 and abs(y) < 36.0 for x, y in xy)
    if count <= 26:
        assert all((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 > 15.9 for a, b in itertools.combinations(xy, 2))


def test_ports_are_those_of_the_simulators():
    assert [url.url for url in fleet_urls(PX4, range(1, 3))] == [
        "udpout:127.0.0.1:14550,18570",
        "udpout:127.0.0.1:14540,14580",
        "udpout:127.0.0.1:14030,14280",
        "udpout:127.0.0.1:13280,13030",
        "udpout:127.0.0.1:14550,18571",
        "udpout:127.0.0.1:14541,14581",
        "udpout:127.0.0.1:14031,14281",
        "udpout:127.0.0.1:13281,13031",
    ]
    apis = [PX4.simulator_urls(index)[1] for index in (8, 9, 10, 249)]
    assert apis == [
        f"udpout:127.0.0.1:{remote},{local}"
        for remote, local in ((14548, 14588), (14549, 14589), (14549, 14590), (14549, 14829))
    ], "none of them at the ground station's port"
    assert fleet_urls(ARDUPILOT, range(1, 4))[2] == ServerUrl("tcpin:127.0.0.1:5780", frozenset((3,)))


def test_ports_of_a_large_fleet_do_not_meet():
    used = [
        port
        for index in range(250)
        for link, url in enumerate(PX4.simulator_urls(index))
        for port in url.rpartition(":")[2].split(",")[link < 2 :]
    ]
    assert len(set(used)) == len(used) == 250 * 6


@pytest.mark.parametrize(
    ("home", "count", "text"),
    [(HOME, 0, "1 to 250"), (HOME, 251, "1 to 250"), ([(HOME, 0.0), (HOME, 0.0)], 3, "a home for each")],
)
def test_impossible_fleets(home, count, text):
    with pytest.raises(VehicleError, match=text):
        Fleet(get_vehicle("quad"), home, count)
    with pytest.raises(VehicleError, match="spacing"):
        quads(2, spacing_m=0.0)


def test_system_ids_follow_the_first():
    fleet = Fleet(get_vehicle("quad"), HOME, 2, first_system=7)
    assert [vehicle.system_id for vehicle in fleet.vehicles] == [7, 8]
    assert {system for url in fleet.urls for system in url.systems} == {7, 8}
    with pytest.raises(VehicleError, match="250 to 251"):
        Fleet(get_vehicle("quad"), HOME, 2, first_system=250)


def test_a_home_for_each():
    other = GeoPoint(28.06, -82.16, 5.0)
    fleet = Fleet(get_vehicle("quad"), [(HOME, 0.0), (other, 90.0)])
    assert [vehicle.home for vehicle in fleet.vehicles] == [HOME, other]


def test_each_vehicle_at_its_own_door_and_all_at_the_router():
    fleet = quads(3, autopilot=ARDUPILOT)
    doors = [ServerUrl("tcpin:127.0.0.1:0", frozenset((system,))) for system in (1, 2, 3)]
    with running(Server(fleet.vehicles, [*doors, "tcpin:127.0.0.1:0"], speed=SPEED)) as server:
        found = []
        for url, expected in zip(server.urls, [{1}, {2}, {3}, {1, 2, 3}], strict=True):
            endpoint = MavlinkEndpoint(open_link(url.replace("tcpin", "tcp")), 255, 190)
            systems = {x.get_srcSystem() for x in hear(endpoint, systems=expected)}
            found.append(systems - {255})
            endpoint.close()
        assert found == [{1}, {2}, {3}, {1, 2, 3}]


def test_commands_reach_the_vehicle_that_is_meant_and_two_grounds_hear_each_other():
    fleet = quads(3)
    with running(Server(fleet.vehicles, ["tcpin:127.0.0.1:0"])) as server:
        url = server.urls[0].replace("tcpin", "tcp")
        one = MavlinkEndpoint(open_link(url), 255, 190)
        two = MavlinkEndpoint(open_link(url), 254, 190)
        one.send(m.MAVLink_command_long_message(2, 1, 400, 0, 1.0, *[0.0] * 6))
        heard = hear(one, 0.3, {2})
        others = hear(two, 0.3, {255})
        acks = [x.get_srcSystem() for x in heard if x.get_type() == "COMMAND_ACK"]
        assert acks == [2]
        assert [vehicle.pilot.armed for vehicle in fleet.vehicles] == [False, True, False]
        assert any(x.get_srcSystem() == 255 for x in others + two.receive())
        assert not any(x.get_type() == "COMMAND_ACK" for x in others)
        one.close(), two.close()


def test_a_command_at_another_vehicles_door_does_not_cross():
    fleet = quads(2)
    with running(
        Server(fleet.vehicles, [ServerUrl("tcpin:127.0.0.1:0", frozenset((1,)))], speed=SPEED)
    ) as server:
        endpoint = MavlinkEndpoint(open_link(server.urls[0].replace("tcpin", "tcp")), 255, 190)
        endpoint.send(m.MAVLink_command_long_message(2, 1, 31999, 0, *[0.0] * 7))
        assert not any(x.get_type() == "COMMAND_ACK" for x in hear(endpoint))
        endpoint.close()


class Listening:
    """A ground station for one vehicle: it notes who is heard."""

    component_id, wanted = 190, None

    def __init__(self, system_id, vehicle_system_id):
        self.system_id, self.vehicle_system_id = system_id, vehicle_system_id
        self.heard = set()

    def receive(self, message, now_s):
        self.heard.add(message.get_srcSystem())
        return []

    def poll(self, now_s):
        return []

    def next_deadline(self):
        return float("inf")


def test_what_serves_a_vehicle_meets_its_link_only_and_links_do_not_cross():
    grounds = [Listening(255, 4), Listening(254, 7)]
    doors = [ServerUrl("tcpin:127.0.0.1:0", frozenset(ids)) for ids in ((4, 5), (7,))]
    with running(Server(grounds, doors)) as server:
        ends = [
            MavlinkEndpoint(open_link(url.replace("tcpin", "tcp")), system, 1)
            for url, system in zip(server.urls, (4, 7), strict=True)
        ]

        def heard():
            for one in ends:
                one.send(m.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3))
            return all(one.heard for one in grounds)

        wait_until(heard)
        assert [one.heard for one in grounds] == [{4}, {7}]
        assert not [x for one in ends for x in one.receive()], "nothing of one link goes over the other"
        for one in ends:
            one.close()


def test_udp_ports_of_px4_with_a_common_ground_station():
    ground, api_1, api_2, from_1, from_2 = free_ports(5)
    fleet = quads(2)
    urls = [
        ServerUrl(f"udpout:127.0.0.1:{ground},{from_1}", frozenset((1,))),
        ServerUrl(f"udpout:127.0.0.1:{api_1}", frozenset((1,))),
        ServerUrl(f"udpout:127.0.0.1:{ground},{from_2}", frozenset((2,))),
        ServerUrl(f"udpout:127.0.0.1:{api_2}", frozenset((2,))),
    ]
    common = MavlinkEndpoint(open_link(f"udpin:127.0.0.1:{ground}"), 255, 190)
    own = MavlinkEndpoint(open_link(f"udpin:127.0.0.1:{api_2}"), 245, 190)
    with running(Server(fleet.vehicles, urls, speed=SPEED)):
        heard = hear(common, systems={1, 2})
        assert {x.get_srcSystem() for x in heard} >= {1, 2}
        assert {x.get_srcSystem() for x in hear(own, systems={2})} - {255} == {2}
    common.close(), own.close()


def flight(home, legs):
    takeoff = MissionItem(
        Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, x=home.latitude_deg, y=home.longitude_deg, z=8.0
    )
    places = [
        MissionItem.waypoint(home.latitude_deg + 1e-4 * (k + 1), home.longitude_deg, 8.0)
        for k in range(legs + 1)
    ]
    return (takeoff, *places, MissionItem(Command.NAV_RETURN_TO_LAUNCH))


def fly_all(path, seed, faults):
    """Three vehicles fly in gusts behind a bad radio; everything goes into a log."""
    wind = Wind.from_direction(4.0, 250.0, gust_m_s=1.5, seed=seed)
    fleet = quads(3, wind=wind)
    with TlogWriter(path) as log:
        simulation = Simulation(fleet.vehicles, tap=log.write, faults=faults, seed=seed)
        link = simulation.open_link()
        driver = TransferDriver(MavlinkEndpoint(link, 255, 190), clock=link.clock, wait=link.wait)
        for vehicle in fleet.vehicles:
            driver.vehicle = None
            driver.wait_for_vehicle(system_id=vehicle.system_id)
            driver.upload(Mission(flight(vehicle.home, vehicle.system_id), home=vehicle.home))
            for command, first in ((m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0), (m.MAV_CMD_MISSION_START, 0.0)):
                for _ in range(6):
                    driver.endpoint.send(
                        m.MAVLink_command_long_message(vehicle.system_id, 1, command, 0, first, *[0.0] * 6)
                    )
                    link.sleep(0.5)
        for _ in range(60):
            link.sleep(2.0)
            link.receive()
    return [vehicle.outcome.value for vehicle in fleet.vehicles], path.read_bytes()


def test_the_same_seed_and_inputs_give_the_same_bytes(tmp_path):
    faults = [
        "loss=0.1",
        "jitter=0.05",
        "corrupt=0.02",
        "duplicate=0.02",
        "no-request=1,times=1",
        "dead-battery,vehicle=2,at=item:2",
        "gps-loss,vehicle=3,at=airborne,from=4,for=3",
    ]
    first = fly_all(tmp_path / "a.tlog", 7, faults)
    again = fly_all(tmp_path / "b.tlog", 7, faults)
    assert len(first[1]) > 100_000
    assert first == again
    assert first[0][:2] == ["completed", "battery_depleted"]


def told_at(endpoint, number):
    """What a vehicle sends over a link, with the sequence numbers of its frames."""
    heard = []
    end_s = time.monotonic() + 30.0
    while len(heard) < number and time.monotonic() < end_s:
        heard += [message for message in endpoint.receive() if message.get_srcSystem() == 1]
        time.sleep(0.01)
    return heard


def test_each_link_of_px4_has_its_own_messages_rates_and_sequence_numbers():
    fleet = quads(1, sitl_rates=True)
    named = [ServerUrl("tcpin:127.0.0.1:0", frozenset((1,)), link) for link in ("", "ground", "gimbal")]
    with running(Server(fleet.vehicles, named)) as server:
        api, ground, gimbal = ends = [
            MavlinkEndpoint(open_link(url.replace("tcpin", "tcp")), 250 + number, 190)
            for number, url in enumerate(server.urls)
        ]
        hear(gimbal, 0.1, {1}), hear(ground, 0.1, {1})
        # Slower over one link; the answer goes there only.
        interval = m.MAVLINK_MSG_ID_AUTOPILOT_STATE_FOR_GIMBAL_DEVICE
        gimbal.send(m.MAVLink_command_long_message(1, 1, 511, 0, interval, 100_000.0, *[0.0] * 5))
        kinds = [{x.get_type() for x in told_at(end, 400)} for end in (api, ground)]
        assert "HIGHRES_IMU" in kinds[0] - kinds[1]
        assert "TIMESYNC" in kinds[0] - kinds[1]
        assert {"ATTITUDE", "SERVO_OUTPUT_RAW", "LOCAL_POSITION_NED"} <= kinds[0] & kinds[1]
        told = told_at(gimbal, 30)
        only = {"HEARTBEAT", "MISSION_CURRENT", "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE", "COMMAND_ACK"}
        assert {x.get_type() for x in told} <= only
        for end, expected in ((api, -1), (gimbal, 100_000)):
            end.send(m.MAVLink_command_long_message(1, 1, 510, 0, interval, *[0.0] * 6))
            heard = told_at(end, 1000 if end is api else 20)
            assert [x.interval_us for x in heard if x.get_type() == "MESSAGE_INTERVAL"][-1] == expected
        told += heard
        numbers = [x.get_seq() for x in told]
        assert numbers == [(numbers[0] + k) % 256 for k in range(len(numbers))], "nothing seems lost"
        for end in ends:
            end.close()
