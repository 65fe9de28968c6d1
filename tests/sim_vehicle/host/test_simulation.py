"""The virtual-clock host."""

import pytest

from mission.link.codec.dialect import mavlink
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.component import NEVER
from sim_vehicle.errors import VehicleError
from sim_vehicle.host.simulation import Impairment, Simulation, StopReason
from sim_vehicle.mavlink import SimVehicle


class Beacon:
    """Sends a heartbeat each period and notes what it hears."""

    def __init__(self, system, component, period_s=1.0, wanted=None, answer=None):
        self.system_id, self.component_id, self.wanted = system, component, wanted
        self.period_s, self.due_s, self.answer = period_s, 0.0 if period_s else NEVER, answer
        self.heard = []

    def receive(self, message, now_s):
        self.heard.append((now_s, message.get_type(), message.get_srcSystem(), message.get_srcComponent()))
        return [] if self.answer is None else self.answer(message, now_s)

    def poll(self, now_s):
        self.due_s += self.period_s
        return [mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)]

    def next_deadline(self):
        return self.due_s


def test_time_jumps_and_broadcasts_reach_all_others():
    a, b, c = Beacon(1, 1), Beacon(1, 100, 0), Beacon(255, 190, 0)
    assert Simulation([a, b, c]).run(limit_s=1000.5) is StopReason.TIME_LIMIT
    assert len(b.heard) == len(c.heard) == 1001
    assert b.heard[500] == (500.0, "HEARTBEAT", 1, 1)
    assert a.heard == []


def test_addressed_messages_go_to_the_address_only():
    def ask(message, now_s):
        return [mavlink.MAVLink_command_long_message(1, 100, 512, 0, 0, 0, 0, 0, 0, 0, 0)]

    vehicle, camera, ground = Beacon(1, 1), Beacon(1, 100, 0), Beacon(255, 190, 0, answer=ask)
    Simulation([vehicle, camera, ground]).run(limit_s=0.5)
    assert [h[1] for h in camera.heard] == ["HEARTBEAT", "COMMAND_LONG"]
    assert vehicle.heard == []


def test_endless_answers_are_stopped(monkeypatch):
    monkeypatch.setattr("sim_vehicle.host.simulation._STEPS_AT_ONE_INSTANT", 1000)

    def again(message, now_s):
        return [mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)]

    a, b = Beacon(1, 1, answer=again), Beacon(2, 1, 0, answer=again)
    assert Simulation([a, b]).run(limit_s=5.0) is StopReason.STALLED


def test_a_deadline_that_never_moves_is_stopped(monkeypatch):
    monkeypatch.setattr("sim_vehicle.host.simulation._STEPS_AT_ONE_INSTANT", 1000)

    class Stuck(Beacon):
        def poll(self, now_s):
            return []

    assert Simulation([Stuck(1, 1)]).run(limit_s=5.0) is StopReason.STALLED


def test_the_tap_sees_each_frame_once_and_frames_parse():
    seen = []
    simulation = Simulation([Beacon(1, 1), Beacon(255, 190, 0.5)], tap=lambda f, t: seen.append((t, f)))
    simulation.run(limit_s=2.25)
    assert [t for t, _ in seen] == [0.0, 0.0, 0.5, 1.0, 1.0, 1.5, 2.0, 2.0]
    assert simulation.frames == 8
    assert simulation.bytes_sent == sum(len(f) for _, f in seen)
    messages = mavlink.MAVLink(None).parse_buffer(b"".join(f for _, f in seen))
    assert [m.get_seq() for m in messages if m.get_srcSystem() == 255] == [0, 1, 2, 3, 4]


def heard_of_a_vehicle(wanted, tap):
    """Let a vehicle talk to a listener that gets a link beside it after a while; return who heard what."""
    vehicle = SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15))
    ground = Beacon(255, 190, 0, wanted=wanted)
    simulation = Simulation([vehicle, ground], tap=tap)
    simulation.run(limit_s=5.05)
    before = simulation.frames
    link = simulation.open_link()
    simulation.run(limit_s=5.0)
    return ground.heard, before, simulation.frames, b"".join(link.receive())


def test_messages_that_nobody_listens_to_count_and_change_nothing():
    wanted = frozenset({mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT})
    told = []
    quiet, loud = heard_of_a_vehicle(wanted, None), heard_of_a_vehicle(wanted, lambda f, t: told.append(f))
    assert quiet == loud
    assert quiet[1] > 2 * len([h for h in quiet[0] if h[0] <= 5.05])
    # Who comes later hears everything, with the sequence numbers of the frames that were only counted.
    assert len(told) == quiet[2] and b"".join(told).endswith(quiet[3]) and quiet[3]


def test_two_components_with_one_address_are_refused():
    with pytest.raises(VehicleError, match="two components"):
        Simulation([Beacon(1, 1), Beacon(1, 1)])


def run_impaired(**impairment):
    vehicle, camera, ground = Beacon(1, 1, 0.1), Beacon(1, 100, 0), Beacon(255, 190, 0)
    seen = []
    simulation = Simulation(
        [vehicle, camera, ground],
        impairment=Impairment(**impairment),
        remote=[ground],
        tap=lambda f, t: seen.append((t, f)),
    )
    simulation.run(limit_s=100.0)
    return camera.heard, ground.heard, seen


def test_impairment_hits_the_radio_only_and_repeats_with_its_seed():
    camera, ground, _ = run_impaired(loss=0.3, duplication=0.1, delay_s=0.05, jitter_s=0.3, seed=7)
    assert len(camera) == 1001
    assert 700 < len(ground) < 850
    assert min(t for t, *_ in ground) > 0.05
    assert run_impaired(loss=0.3, duplication=0.1, delay_s=0.05, jitter_s=0.3, seed=7)[1] == ground
    assert run_impaired(loss=0.3, duplication=0.1, delay_s=0.05, jitter_s=0.3, seed=8)[1] != ground


@pytest.mark.parametrize(
    "bad", [{"loss": 1.5}, {"duplication": -0.1}, {"delay_s": -1.0}, {"jitter_s": NEVER}]
)
def test_impairments_that_make_no_sense_are_refused(bad):
    with pytest.raises(VehicleError, match=next(iter(bad))):
        Impairment(**bad)
