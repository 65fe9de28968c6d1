"""A real vehicle's mission is changed over links that break after any message of the change."""

import math
from functools import cache

import pytest
from live_changes import FRAME, LONG, LiveChange, keys
from sweeps import slow

from mission.ground.change import ChangeOutcome
from mission.ground.modes import Maneuver
from mission.outcome import Outcome
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.host.simulation import Impairment

AUTOPILOTS = ("px4", "ardupilot")
GOOD = frozenset({Outcome.COMPLETED, Outcome.LINK_LOST})


@cache
def messages_of_a_change(autopilot):
    """Return the messages of the protocols that cross the link while a mission is changed."""
    flight = LiveChange(autopilot, lands_soon=True).fly()
    assert [one.outcome for one in flight.station.changes] == [ChangeOutcome.DONE]
    flight.check_safe()
    return tuple(flight.link.crossed)


@cache
def undisturbed(autopilot, *, on_board=False):
    """Return a flight whose mission is not changed, over a link that does not break."""
    return LiveChange(autopilot, new=(), on_board=on_board).fly()


def check_break(autopilot, after, dead_s):
    flight = LiveChange(autopilot, after=after, dead_s=dead_s, lands_soon=True).fly()
    assert flight.link.broke_s < math.inf
    flight.check_safe()
    if math.isinf(dead_s):
        return
    assert flight.station.outcome in GOOD, (after, flight.station.reason)
    (change,) = flight.station.changes
    came = change.outcome is ChangeOutcome.DONE or change.text.startswith("the vehicle had left its mission")
    held = keys(flight.new) if came else keys(flight.old)
    assert tuple((one.command, one.x, one.y) for one in flight.vehicle.pilot.mission.items) == held
    assert keys(flight.station.mission) == held, "the ground knows which one it holds"
    report = flight.station.link_report
    assert report.worst_silence_s >= dead_s - 3.0
    assert report.silent_s >= report.worst_silence_s


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_link_that_breaks_during_a_change(autopilot):
    count = len(messages_of_a_change(autopilot))
    for after in range(2, count, count // 2):
        check_break(autopilot, after, 40.0)


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_ground_computer_that_dies_during_a_change(autopilot):
    count = len(messages_of_a_change(autopilot))
    for after in range(4, count, count // 2):
        check_break(autopilot, after, math.inf)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
@pytest.mark.parametrize("dead_s", [40.0, math.inf])
def test_a_link_that_breaks_after_any_message_of_a_change(autopilot, dead_s):
    for after in range(1, len(messages_of_a_change(autopilot)) + 1):
        check_break(autopilot, after, dead_s)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_change_over_a_link_that_loses_a_third_and_takes_two_seconds(autopilot):
    bad = Impairment(loss=0.3, delay_s=2.0, seed=4)
    flight = LiveChange(autopilot, impairment=bad, old=LONG).fly()
    flight.check_safe()
    (record,) = flight.station.changes
    assert record.outcome is ChangeOutcome.DONE, record
    assert flight.station.outcome is Outcome.COMPLETED
    assert keys(flight.station.mission) == keys(flight.new)
    report = flight.station.link_report
    assert report.round_trip_s == pytest.approx(4.0, abs=0.3)
    assert report.loss == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize(
    ("autopilot", "delay_s", "on_board"),
    [("px4", 0.1, True), ("ardupilot", 0.3, True), ("ardupilot", 0.3, False)],
)
def test_a_change_that_comes_after_the_last_image_of_the_old_mission(autopilot, delay_s, on_board):
    """While the order is on its way the vehicle passes the item that ends the images; they go on."""
    late = Impairment(delay_s=delay_s, seed=1)
    flight = LiveChange(autopilot, impairment=late, on_board=on_board, change_at=6, near_m=4.0).fly()
    flight.check_safe()
    (change,) = flight.station.changes
    if autopilot == "px4":  # it returns by then, which no list of items ends
        assert (change.outcome, change.text) == (
            ChangeOutcome.GIVEN_UP,
            "the vehicle had left its mission (RTL)",
        )
        return
    assert change.outcome is ChangeOutcome.DONE
    images_of_old = 33
    assert flight.assembler.statistics.images > images_of_old + 15


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_an_autopilot_that_starts_again_in_flight(autopilot):
    """Its clock, its streams and the ids of its plans begin anew; ours go on, and so does the camera."""
    whole = undisturbed(autopilot)
    flight = LiveChange(autopilot, new=()).to_images(8)
    flight.vehicle.reboot()
    flight.fly().check_safe()
    station = flight.station
    assert station.outcome is Outcome.COMPLETED
    assert [text for _, text in station.pilot.events] == ["its autopilot has started again"]
    assert abs(station.flight_time_s - whole.station.flight_time_s) < 5.0
    track = station.tracks.track(FRAME)
    assert (track.time_s[1:] >= track.time_s[:-1]).all()
    assert abs(track.length_m - whole.station.tracks.track(FRAME).length_m) < 5.0
    assert flight.assembler.statistics.images >= whole.assembler.statistics.images - 6
    seen = flight.assembler.take()
    assert (seen.time_s[1:] >= seen.time_s[:-1]).all()
    assert len(seen) == 0 or seen.time_s[-1] <= track.time_s[-1] + 1.0


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
@pytest.mark.parametrize("silent_s", [3.0, 10.0])
def test_an_autopilot_that_starts_again_with_its_motors_off(autopilot, silent_s):
    flight = LiveChange(autopilot, dead_s=silent_s, new=()).to_images(8)
    vehicle = flight.vehicle
    flight.link.broke_s = flight.simulation.now_s
    vehicle.pilot.disarm(force=True)
    vehicle.pilot.modes.override(vehicle.firmware.mavlink.modes.boot)
    vehicle.reboot()
    flight.fly()
    station = flight.station
    assert station.outcome is Outcome.AUTOPILOT_RESTARTED
    assert station.reason.startswith("its autopilot has started again: mode ")
    assert station.reason.endswith(", motors off")
    assert [text for _, text in station.pilot.events] == [station.reason]
    assert flight.assembler.statistics.images >= 8


@pytest.mark.parametrize("seed", [2, *(slow(seed) for seed in (3, 7))])
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_images_of_a_camera_on_board_come_over_a_bad_link(autopilot, seed):
    bad = Impairment(loss=0.3, delay_s=0.5, seed=seed)
    flight = LiveChange(autopilot, dead_s=10.0, impairment=bad, new=(), on_board=True).to_images(8)
    flight.link.broke_s = flight.simulation.now_s
    flight.fly().check_safe()
    whole = undisturbed(autopilot, on_board=True)
    assert flight.assembler.missing() == []
    assert flight.assembler.statistics.images == whole.assembler.statistics.images > 20


def test_what_a_camera_beside_the_vehicle_could_not_see_is_counted():
    flight = LiveChange("px4", dead_s=10.0, new=()).to_images(8)
    flight.link.broke_s = flight.simulation.now_s
    flight.fly().check_safe()
    missing = undisturbed("px4").assembler.statistics.images - flight.assembler.statistics.images
    assert flight.camera.missed == pytest.approx(missing, abs=4)
    assert missing > 5


def test_an_arducopter_never_gets_a_failsafe_that_would_break_its_mission_off():
    """The link breaks after each setting; the mission in the mission mode goes on."""
    crossed = messages_of_a_change("ardupilot")
    settings = [k for k, kind in enumerate(crossed, 1) if kind == "PARAM_SET"]
    assert len(settings) == 3
    for after in settings:
        flight = LiveChange("ardupilot", after=after, dead_s=math.inf, lands_soon=True).fly()
        assert Mode.RTL not in flight.modes
        flight.check_safe()


def is_home(flight, below_m):
    station = flight.station
    return lambda _now_s: station.flies_home and station.vehicle_state.height_m < below_m


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
@pytest.mark.parametrize("arrives", [True, False])
def test_an_order_in_the_last_metre_counts_when_it_is_obeyed(autopilot, arrives):
    """What is ordered on the way home may come too late; then the mission was flown to its end."""
    flight = LiveChange(autopilot, new=(), dead_s=math.inf if arrives else 60.0).to_images(8)
    station, simulation = flight.station, flight.simulation
    simulation.run(until=is_home(flight, 1.0), limit_s=300.0)
    order = station.maneuver(Maneuver.LAND if arrives else Maneuver.HOLD, simulation.now_s)
    if arrives:
        simulation.send(station, order)
    else:
        # Nothing of it gets across until it has landed.
        flight.link.dead_s, flight.link.broke_s = 20.0, simulation.now_s
    simulation.run(until=lambda _now_s: station.done, limit_s=300.0)
    assert station.done
    if arrives:
        assert station.outcome is Outcome.INTERRUPTED
        assert station.pilot.obeyed == "lands (mode LAND)"
    else:
        assert station.outcome is Outcome.COMPLETED, station.reason
        assert not station.pilot.obeyed
