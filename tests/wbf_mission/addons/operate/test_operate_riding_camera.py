"""The leaf camera beside an autopilot, message by message: who tells it what to do, and what gets lost."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_changes import HOME, SameEverywhere
from sweeps import sweep

from geo.farms import get_farm
from mission.ground.items import shots_before
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Mission, MissionItem
from sensors.camera.leaf_camera import LeafCamera
from sim_vehicle.camera.component import LeafCameraComponent
from wbf_mission.addons.operate.riding_camera import RidingCamera

DISTANCE, INTERVAL = int(Command.DO_SET_CAM_TRIGG_DIST), int(Command.DO_SET_CAM_TRIGG_INTERVAL)
AUTO, GUIDED = 3, 4
PATIENCE_S = 4.0
"""After so long the camera does what the mission orders, whatever was lost; two reports of the item."""


def plan(*orders):
    """A leg, and then each order with a leg after it."""
    leg = MissionItem(Command.NAV_WAYPOINT, x=27.0, y=-82.0, z=10.0)
    items = [leg]
    for command, value in orders:
        items += [MissionItem(command, param1=value), leg]
    return Mission(tuple(items))


MISSION = plan((DISTANCE, 0.5), (DISTANCE, 0.0))


class Ride:
    """An ArduCopter, by its messages, and the camera that rides beside it."""

    def __init__(self, mission=MISSION):
        self.mission, self.changing = mission, False
        farm = get_farm("miniberry-10")
        inner = LeafCameraComponent(LeafCamera(SameEverywhere(), farm.grid().shape, 1), farm)
        self.camera = RidingCamera(inner, lambda: self.mission, lambda: self.changing)
        self.trigger = inner.trigger
        self.now_s, self.clock_s, self.sent = 0.0, 100.0, []
        self.beat()
        self.move(0.1)

    def hear(self, message, source=(1, 1)):
        message.pack(m.MAVLink(None, *source))
        out = self.camera.receive(message, self.now_s)
        self.sent += out
        return out

    def beat(self, mode=AUTO, *, armed=True):
        base = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (m.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
        self.hear(m.MAVLink_heartbeat_message(m.MAV_TYPE_QUADROTOR, 3, base, mode, 4, 3))

    def move(self, seconds):
        self.now_s += seconds
        self.clock_s += seconds
        lat, lon = round(HOME.latitude_deg * 1e7), round(HOME.longitude_deg * 1e7)
        self.hear(
            m.MAVLink_global_position_int_message(
                round(1e3 * self.clock_s), lat, lon + round(100 * self.clock_s), 30_000, 10_000, 0, 100, 0, 0
            )
        )

    def at(self, item):
        """Its item, counted as the mission's are; an ArduPilot's list begins with home."""
        self.hear(m.MAVLink_mission_current_message(item + 1, 5, 3, 1))

    def tell(self, value, command=DISTANCE, source=(1, 1), **more):
        confirmation = more.get("confirmation", 0)
        order = m.MAVLink_command_long_message(1, 100, command, confirmation, value, 0, 1, 0, 0, 0, 0)
        return self.hear(order, source)

    def seconds(self, count, item, mode=AUTO):
        for _ in range(count):
            self.move(1.0)
            self.beat(mode)
            self.at(item)

    @property
    def does(self):
        return self.trigger.distance_m, self.trigger.interval_us


def kinds(messages):
    return [one.get_type() for one in messages]


def test_a_camera_that_nobody_commands_follows_the_mission():
    ride = Ride()
    told = []
    for item in (0, 2, 2, 65534, 4):
        ride.at(item)
        told.append(ride.does[0])
    assert told == [0.0, 0.5, 0.5, 0.5, 0.0]
    assert kinds(ride.sent) == ["CAMERA_IMAGE_CAPTURED", "DEBUG_FLOAT_ARRAY"], (
        "and nobody asked for an answer"
    )
    camera = Ride().camera
    assert camera.poll(0.5) == [], "it listens first"
    assert "HEARTBEAT" in kinds(camera.poll(5.0))
    assert kinds(camera.goodbye()) == ["HEARTBEAT"]


@pytest.mark.parametrize("item_first", [False, True])
def test_a_silence_costs_the_same_whatever_is_heard_first_after_it(item_first):
    legs = [
        MissionItem.waypoint(HOME.latitude_deg, HOME.longitude_deg + 1e-3 + 2e-4 * k, 10.0) for k in range(3)
    ]
    on, off = (MissionItem(DISTANCE, param1=value) for value in (0.5, 0.0))
    ride = Ride(Mission((legs[0], on, legs[1], off, legs[2])))
    ride.seconds(3, item=2)
    assert ride.does[0] == 0.5
    if item_first:
        ride.at(4)
    ride.move(20.0)
    ride.at(4)
    # The rest of a leg of 20 m, of which 3 m lie behind it, an image every half a metre.
    assert ride.camera.missed == pytest.approx(33, abs=3)


def test_two_silences_before_an_item_is_told_cost_both():
    ends = [MissionItem.waypoint(HOME.latitude_deg, HOME.longitude_deg + 2e-3 * k, 10.0) for k in range(2)]
    ride = Ride(Mission((ends[0], MissionItem(DISTANCE, param1=0.5), ends[1])))
    ride.seconds(3, item=2)
    for seconds in (10.0, 1.0, 8.0, 1.0):
        ride.move(seconds)
    ride.at(2)
    # 18 s of 20, with 0.98 m/s.
    assert ride.camera.missed == pytest.approx(35, abs=1)


def test_a_command_of_the_autopilot_is_given_time_to_arrive():
    ride = Ride()
    ride.tell(0.5)
    ride.at(4)
    assert ride.does[0] == 0.5, "the command that ends it may be on its way"
    ride.move(1.0)
    ride.tell(0.0)
    ride.seconds(10, 4)
    assert ride.does[0] == 0.0


def test_what_a_ground_station_ordered_holds_until_the_mission_orders_something_else():
    ride = Ride(plan((DISTANCE, 0.5), (DISTANCE, 0.7), (DISTANCE, 0.0)))
    ride.at(2)
    ride.tell(0.0, source=(255, 190))
    ride.seconds(10, 2)
    assert ride.does[0] == 0.0
    ride.seconds(1, 4)
    assert ride.does[0] == pytest.approx(0.7)


def test_a_series_of_n_images_is_left_to_the_autopilot():
    start, stop = int(Command.IMAGE_START_CAPTURE), int(Command.IMAGE_STOP_CAPTURE)
    items = plan((DISTANCE, 0.5), (start, 0.0), (start, 0.0), (stop, 0.0)).items
    series = [replace(items[k], param2=0.5, param3=count) for k, count in ((3, 3.0), (5, 0.0))]
    ride = Ride(Mission((*items[:3], series[0], items[4], series[1], *items[6:])))
    ride.seconds(1, 2)
    assert ride.does == (0.5, 0)
    ride.hear(m.MAVLink_command_long_message(1, 100, start, 0, 0, 0.5, 3, 1, 0, 0, 0))
    images = kinds(ride.sent).count("CAMERA_IMAGE_CAPTURED")
    ride.seconds(10, 4)
    assert ride.does == (0.0, 0) and kinds(ride.sent).count("CAMERA_IMAGE_CAPTURED") == images + 3
    ride.seconds(round(PATIENCE_S), 6)
    assert ride.does == (0.0, 500_000), "a series without end is taken up"
    ride.seconds(round(PATIENCE_S), 8)
    assert ride.does == (0.0, 0)


def test_an_autopilot_that_orders_each_image_is_left_to_it():
    ride = Ride()
    ride.at(2)
    assert ride.does[0] == 0.5
    ride.hear(m.MAVLink_camera_trigger_message(round(1e6 * ride.clock_s), 1))
    assert ride.does[0] == 0.0, "each image would be taken twice"
    ride.seconds(10, 2)
    assert ride.does[0] == 0.0


def test_a_changed_mission_does_not_end_the_images_by_an_item_of_the_other_one():
    ride = Ride()
    ride.at(2)
    ride.changing = True
    ride.seconds(10, 4)
    assert ride.does[0] == 0.5
    ride.mission, ride.changing = plan((DISTANCE, 0.5), *[(DISTANCE, 0.5)] * 3), False
    ride.seconds(1, 4)
    assert ride.does[0] == 0.5


def test_a_camera_on_board_has_the_field_to_itself():
    ride = Ride()
    ride.hear(m.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3), (1, 100))
    ride.at(2)
    assert ride.does[0] == 0.0
    assert ride.camera.next_deadline() == float("inf")
    assert ride.camera.poll(9.0) == ride.camera.goodbye() == []


VALUES = st.sampled_from([0.0, 0.5, 0.75])
STEPS = st.one_of(
    st.tuples(st.just("item"), st.integers(0, 6)),
    # A command of the vehicle: lost, or late by so many steps, or one that is repeated and comes again.
    st.tuples(st.just("command"), VALUES, st.integers(0, 3), st.integers(1, 3), st.booleans()),
    st.tuples(st.just("guided"), st.integers(1, 4)),
    st.tuples(st.just("changed"), st.lists(VALUES, min_size=1, max_size=3)),
    st.tuples(st.just("changing"), st.booleans()),
    st.tuples(st.just("restart")),
    st.tuples(st.just("silence"), st.integers(1, 20)),
)


@sweep(few=50, many=300)
@given(st.lists(VALUES, min_size=1, max_size=3), st.lists(STEPS, max_size=15), st.integers(0, 6))
def test_whatever_is_lost_the_camera_does_in_the_end_what_the_mission_orders(first, steps, last):
    ride = Ride(plan(*[(DISTANCE, value) for value in first]))
    on_the_way = []
    item = 0
    for step in steps:
        if step[0] == "item":
            item = step[1]
        elif step[0] == "command":
            _, value, late, copies, lost = step
            if not lost:
                on_the_way += [(late + k, value, k) for k in range(copies)]
        elif step[0] == "guided":
            ride.seconds(step[1], item, GUIDED)
        elif step[0] == "changed":
            ride.mission = plan(*[(DISTANCE, value) for value in step[1]])
        elif step[0] == "changing":
            ride.changing = step[1]
        elif step[0] == "restart":
            ride.clock_s = 1.0
        else:
            ride.move(step[1])
        ride.seconds(1, item)
        for left, value, k in on_the_way:
            if left == 0:
                ride.tell(value, confirmation=k)
        on_the_way = [(left - 1, value, k) for left, value, k in on_the_way if left > 0]
    ride.changing = False
    ride.seconds(round(PATIENCE_S), last)
    ordered = shots_before(ride.mission.items, last)
    if ordered is not None:
        assert ride.does[0] == ordered.distance_m


PX4_MISSION, PX4_RTL = 4 << 16 | 4 << 24, 4 << 16 | 5 << 24
HOMEWARD = Mission((*MISSION.items[:-1], MissionItem(Command.NAV_RETURN_TO_LAUNCH)))


class Px4Ride(Ride):
    """A PX4, whose list begins with its first item."""

    def beat(self, mode=PX4_MISSION, *, armed=True):
        base = 157 if armed else 29
        self.hear(m.MAVLink_heartbeat_message(m.MAV_TYPE_QUADROTOR, 12, base, mode, 4, 3))

    def seconds(self, count, item, mode=PX4_MISSION):
        super().seconds(count, item, mode)

    def at(self, item, state=3):
        self.hear(m.MAVLink_mission_current_message(item, 5, state, 1))


@pytest.mark.parametrize("commanded", [False, True])
@pytest.mark.parametrize("told", [4, 2])
def test_a_px4_that_ends_its_mission_with_a_return_leaves_no_images_on(commanded, told):
    """It shows AUTO.RTL first, then the item; of a mission that came meanwhile it tells an earlier one."""
    ride = Px4Ride(HOMEWARD)
    if commanded:
        ride.tell(0.5)
    ride.seconds(3, 2)
    assert ride.does[0] == 0.5
    ride.move(0.3)
    ride.beat(PX4_RTL)
    ride.move(0.03)
    ride.at(told, state=5)
    ride.seconds(int(PATIENCE_S), told, PX4_RTL)
    assert ride.does[0] == 0.0
    ride.beat(PX4_MISSION)
    ride.seconds(int(PATIENCE_S), 2, PX4_MISSION)
    assert ride.does[0] == 0.5, "it is back in its mission"
