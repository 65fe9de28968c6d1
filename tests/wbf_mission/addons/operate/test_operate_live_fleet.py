"""Fleets over links: simulators in other processes stand for the vehicles, several times faster than real."""

import contextlib
import json
import socket
import time
from types import SimpleNamespace

import numpy as np
import pytest
from processes import FARM, JOB, flying, run_forked, simulator
from stand_in import Watcher, scenario, stand_in

from mission.ground.arming_gate import ArmingGate, Stage
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from mission.outcome import Outcome, Phase
from mission.policies.observation import Status
from mission.transfer.events import NoVehicleError
from mission.transfer.vehicles import Vehicle
from wbf_mission.addons.base.links import LinkHost, LiveFlightError, fitted_to, links_of, via_named
from wbf_mission.addons.operate.link import LiveLink, wanted_vehicles
from wbf_mission.cli.app import main
from wbf_mission.events import EventStream
from wbf_mission.flight import fly
from wbf_mission.replanning.loop import DecisionLoop
from wbf_mission.run import joint_flight, sortie
from wbf_mission.run.hosting import VirtualHosting
from wbf_mission.run.joint_flight import JointFlight
from wbf_mission.run.resolve import resolve

A, B = "tcp:127.0.0.1:1", "tcp:127.0.0.1:2"
FAST = 8
WIDE = ("--farm", "miniberry-30")


def by_id(flights):
    return {one["vehicle"] if isinstance(one, dict) else one.system_id: one for one in flights}


def homes_of(autopilots, farm="miniberry-10"):
    """Return where the vehicles of a fleet stand by their plans."""
    fleet = resolve(scenario(farm=farm, vehicles=len(autopilots), autopilot=",".join(autopilots))).vehicles
    homes = []
    for vehicle in fleet:
        builder = vehicle.task.builder
        latitude, longitude = builder.farm.frame.to_wgs84(*builder.home_m)
        homes.append(GeoPoint(float(latitude), float(longitude), builder.farm.frame.altitude_m))
    return homes


@contextlib.contextmanager
def pair(folder, *more, autopilots=("px4", "ardupilot"), listen=1):
    """Run two simulators as processes of their own; yields their links."""
    ports = ("tcpin:127.0.0.1:0",) * listen
    homes = [
        f"{home.latitude_deg:.8f},{home.longitude_deg:.8f},{home.altitude_m}"
        for home in homes_of(autopilots, *more[1:])
    ]
    with contextlib.ExitStack() as stack:
        yield [
            stack.enter_context(
                simulator(
                    folder / f"sim-{number}",
                    *("--system-id", number, *more),
                    *("--home", homes[number - 1]),
                    autopilot=autopilot,
                    speed=FAST,
                    listen=ports,
                )
            )
            for number, autopilot in enumerate(autopilots, 1)
        ]


def test_two_vehicles_of_two_autopilots_fly_together(quick_stand_in, tmp_path, capsys):
    """In flight the link of one loses 30 % of all frames, each way."""
    # An upload at eight times real time meets an eighth of the vehicle's patience.
    bad = ("loss=0.3,at=airborne",)
    first_home, second_home = homes_of(("px4", "ardupilot"))
    given = [*FARM, *JOB, "--planner", "lawnmower", "--budget", "150s", "--yes", "--json", "--no-plots"]
    with (
        quick_stand_in("px4", speed=FAST, homes=[(first_home, 0.0)]) as (one, _),
        quick_stand_in(
            "ardupilot", speed=FAST, homes=[(second_home, 0.0)], first_system=2, system_faults=bad
        ) as (two, _),
    ):
        code = main(["fly", *given, "--connect", two, "--connect", one, "--out", str(tmp_path / "run")])
    out, told = capsys.readouterr()
    summary = json.loads(out)
    assert (code, summary["outcome"]) == (0, "completed"), told
    assert summary["vehicles"] == 2
    assert summary["scenario"]["autopilot"] == "px4,ardupilot", "in the order of their system ids"
    first, second = summary["flights"]
    assert (first["vehicle"], second["vehicle"]) == (1, 2)
    assert first["link"]["loss"] < 0.05
    assert 0.15 < second["link"]["loss"] < 0.45
    assert first["images"]["images"] > 10
    for text in (
        "vehicle 1: MISSION, item",
        "vehicle 2: AUTO, item",
        "warning: vehicle 1: preflight: the vehicle would not return at the height",
        "vehicle 1: flying",
    ):
        assert text in told
    assert summary["least_distance_m"] > 2.0


@pytest.mark.slow
def test_three_vehicles_share_one_link(tmp_path):
    """Four are heard there; those that are named fly."""
    with (
        simulator(tmp_path, "--count", "4", speed=FAST) as (url,),
        flying(
            tmp_path,
            url,
            *("--system-id", "2", "--system-id", "3", "--system-id", "4"),
            decider=("--policy", "greedy"),
        ) as ground,
    ):
        ended = ground.end()
    assert ended.ended == (0, "completed"), ended.told
    assert list(by_id(ended.summary["flights"])) == [2, 3, 4]
    assert all(one["link"]["loss"] < 0.02 for one in ended.summary["flights"])
    decided = {change["vehicle"] for one in ended.summary["decisions"] for change in one["changes"]}
    assert decided == {2, 3, 4}


@pytest.mark.slow
def test_a_vehicle_that_is_killed_gives_its_part_to_the_other(tmp_path, monkeypatch):
    # Of the 30 s that the flight takes; a busy machine may keep the other one silent, too, for a while.
    monkeypatch.setattr(sortie, "SILENT_S", 6.0)
    monkeypatch.setattr(joint_flight, "SILENT_FOR_GOOD_S", 7.5)
    monkeypatch.setattr(joint_flight, "SILENT_FACTOR", 0.02)
    chosen = scenario(farm="miniberry-30", budget="4min")
    with pair(tmp_path, *WIDE) as (one, two):
        operator = Watcher(vehicle=2, images=15, act=lambda _flight: two.process.kill())
        result = fly(chosen, by=LiveLink((*one, *two), operator))
    assert operator.acted
    flights = by_id(result.flights)
    assert flights[2].outcome is Outcome.NO_ANSWER
    assert flights[1].outcome is Outcome.COMPLETED, flights[1].reason
    begun_s = [one.track.time_s[0] for one in result.flights]
    assert abs(begun_s[0] - begun_s[1]) < 4.0, "they started together, whenever they were switched on"
    assert begun_s[0] - 1.0 < result.observations.time_s[0] < begun_s[0] + 30.0
    (handed,) = [one for one in result.decisions if one.event == "lost"]
    assert [(one.system_id, one.outcome) for one in handed.changes] == [(1, "flown")]
    # The first one has flown over land that was planned for the other.
    theirs = flights[2].plan.path_m
    flown = np.column_stack((flights[1].track.x_m, flights[1].track.y_m))
    away_m = np.hypot(*(flown[None] - theirs[:, None]).transpose(2, 0, 1)).min(axis=1)
    before_m = np.hypot(*(flights[1].plan.path_m[None] - theirs[:, None]).transpose(2, 0, 1)).min(axis=1)
    assert (away_m < 2.0).sum() > (before_m < 2.0).sum() + 3


@pytest.mark.slow
def test_a_pilot_takes_one_and_the_other_flies_on(tmp_path):
    with (
        pair(tmp_path, *WIDE, listen=2) as ((one, _), (two, his)),
        flying(tmp_path, one, "--connect", two, "--budget", "4min", *WIDE) as ground,
    ):
        ground.wait_for("vehicle 2: AUTO, item")
        assert run_forked(("command", his, "land"), tmp_path) == 0
        ended = ground.end()
    assert ended.ended == (1, "pilot_took_over"), ended.told
    flights = by_id(ended.summary["flights"])
    assert flights[1]["outcome"] == "completed"
    assert "vehicle 2: taken out of its mission: mode LAND" in ended.told
    assert "vehicle 1: taken out" not in ended.told


def test_no_vehicle_starts_before_all_that_are_left_can():
    fleet = [
        SimpleNamespace(
            system_id=number,
            done=False,
            start_delay_s=delay_s,
            ground=SimpleNamespace(arming_gate=ArmingGate((number, 1), agreed=True), phase=Phase.READY),
        )
        for number, delay_s in ((1, 0.0), (2, 10.0), (3, 0.0))
    ]
    host = SimpleNamespace(now_s=0.0, send=print)
    given = {"hosting": VirtualHosting(), "events": EventStream(), "watch": None}
    flight = JointFlight(fleet, None, [], host, expected_s=1.0, **given)
    ready = m.MAV_SYS_STATUS_PREARM_CHECK

    def stages(now_s):
        host.now_s = now_s
        flight._let_start()
        return [one.ground.arming_gate.stage for one in fleet]

    def say(one, can):
        message = m.MAVLink_sys_status_message(ready, ready, ready * can, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        one.ground.arming_gate.on_sys_status(message, has_position=True)

    say(fleet[0], True), say(fleet[1], True)
    assert stages(1.0) == [Stage.WAITING, Stage.WAITING, Stage.CHECKING]
    say(fleet[2], True)
    fleet[2].ground.phase = Phase.UPLOAD
    assert stages(1.5) == [Stage.WAITING] * 3, "it is not asked for its word yet"
    say(fleet[0], False)
    fleet[2].done = True
    assert stages(2.0) == [Stage.CHECKING, Stage.WAITING, Stage.WAITING]
    say(fleet[0], True)
    assert stages(3.0)[:2] == [Stage.GRANTED, Stage.WAITING]
    assert stages(12.0)[1] is Stage.WAITING
    assert stages(13.0)[1] is Stage.GRANTED


def test_a_lost_vehicle_is_told_of_when_another_can_take_over():
    statuses = {1: Status.CLIMBING, 2: Status.LOST}
    vehicles = [
        SimpleNamespace(system_id=number, status=lambda _now_s, number=number: statuses[number])
        for number in statuses
    ]
    loop = DecisionLoop(None, "", None, records=[])
    assert not loop.lost(vehicles, 0.0)
    statuses[1] = Status.FLYING
    assert loop.lost(vehicles, 0.0)


@pytest.mark.parametrize(
    ("urls", "ids", "named", "text"),
    [
        ((A, B), (), 3, "do not match"),
        ((A, B, A), (1, 2), 1, "do not match"),
        ((A,), (1, 2), 3, "do not match"),
        ((A,), (2, 2), 1, "system 2 is named twice"),
        ((A,), (), 11, "at most 10"),
    ],
)
def test_links_and_vehicles_have_to_fit(urls, ids, named, text):
    with pytest.raises(LiveFlightError, match=text):
        wanted_vehicles(urls, ids, named)


def test_one_link_may_be_named_for_each_of_its_vehicles():
    assert wanted_vehicles((A, A, B), (4, 5, 1), 1) == ((A, 4), (A, 5), (B, 1))
    links = links_of([(A, Vehicle(4, 1, 3, 2)), (A, Vehicle(5, 1, 3, 2)), (B, Vehicle(1, 1, 3, 2))])
    assert [(one.url, sorted(one.systems)) for one in links] == [(A, [4, 5]), (B, [1])]


def test_vehicles_are_those_of_their_connections_in_the_order_of_their_ids():
    given = scenario(vehicle="quad,mapping-quad")
    fitted = fitted_to(given, Vehicle(7, 1, m.MAV_AUTOPILOT_PX4, 2), Vehicle(3, 1, 3, 2))
    assert fitted.vehicle.fleet == ("mapping-quad", "quad")
    assert fitted.vehicle.autopilots == ("ardupilot", "px4")
    with pytest.raises(LiveFlightError, match="a rover is heard as system 3"):
        fitted_to(given, Vehicle(7, 1, 12, 2), Vehicle(3, 1, 12, m.MAV_TYPE_GROUND_ROVER))


def test_two_vehicles_with_one_system_id_are_refused():
    with (
        stand_in() as (one, _),
        stand_in() as (two, _),
        pytest.raises(LiveFlightError, match=r"system 1 is heard on .* MAV_SYS_ID"),
    ):
        fly(scenario(vehicles=2), by=LiveLink((one, two), Watcher()))


def test_a_vehicle_that_is_not_there_is_told(quick_stand_in):
    with (
        quick_stand_in() as (url, _),
        pytest.raises(NoVehicleError, match="no vehicle besides system 1 was heard"),
    ):
        fly(scenario(vehicles=2), by=LiveLink(url, Watcher(), wait_s=1.5))


def test_mavsdk_flies_one_vehicle():
    pytest.importorskip("mavsdk")
    with pytest.raises(LiveFlightError, match="--via mavsdk flies one vehicle, not 2"):
        fly(scenario(), by=LiveLink((A, B), Watcher(), via=via_named("mavsdk")))


def test_the_senders_whose_datagrams_were_dropped_are_named(monkeypatch):
    """Of two ports: a vehicle's, and one that a stranger floods."""
    monkeypatch.setattr("mission.link.sockets._MOST_BYTES", 32 * 500)
    notes = []
    host = LinkHost([], ["udpin:127.0.0.1:0"] * 2, at_once=True, note=notes.append)
    stranger, vehicle = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with stranger, vehicle:
        for sender, count in ((stranger, 40), (vehicle, 1)):
            for url in host.urls * count:
                sender.sendto(bytes(244), ("127.0.0.1", int(url.split(":")[-1])))
        end_s = time.monotonic() + 30.0
        while host.dropped.total() < 18 and time.monotonic() < end_s:
            time.sleep(0.01)
        named = f"127.0.0.1:{stranger.getsockname()[1]} (18)"
    host.close()
    assert notes == [f"datagrams of {named} were dropped: this program was too busy to receive them"]
