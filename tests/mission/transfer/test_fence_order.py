"""A new fence and the old mission of a vehicle that checks one against the other (PX4)."""

import pytest

from mission.errors import TransferError
from mission.ground.arming_gate import ArmingGate
from mission.ground.contact import Contact
from mission.ground.station import GroundStation
from mission.ground.uploads import PlanUploads
from mission.link.address import MavlinkEndpoint
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, Mission, MissionItem, MissionType
from mission.outcome import Outcome
from mission.transfer import OWN_TRANSFERS, MissionDownload, TransferMaker, VerifiedUpload
from mission.transfer.driver import TransferDriver
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot, with_autopilot
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle

HOME = GeoPoint(28.05, -82.15, 20.0)
KINDS = (MissionType.FENCE, MissionType.MISSION)


def there(north, autopilot="px4"):
    """A mission with a fence about it, so many degrees north of home, which lies in all of these fences."""
    x, y = HOME.latitude_deg, HOME.longitude_deg
    corners = ((-1e-4, -1e-3), (-1e-4, 1e-3), (north + 1e-4, 1e-3), (north + 1e-4, -1e-3))
    fence = tuple(MissionItem(5001, 0, 4.0, x=x + dx, y=y + dy) for dx, dy in corners)
    items = (
        MissionItem(22, 3, x=x, y=y, z=10.0),
        MissionItem.waypoint(x + 1e-4, y, 10.0),
        MissionItem.waypoint(x + north, y, 10.0),
        MissionItem(20),
    )
    return Mission(items, HOME, fence=fence)


OLD, NEW = there(1e-3), there(5e-4)


class Swallowing:
    """A link that loses what the ground sends of one kind, after so many of it."""

    def __init__(self, link, kind, after):
        self.link, self.kind, self.after = link, kind, after
        self.name = link.name

    def send(self, data):
        if data[7] | data[8] << 8 == self.kind:
            self.after -= 1
            if self.after < 0:
                return
        self.link.send(data)

    def receive(self):
        return self.link.receive()

    def fileno(self):
        return self.link.fileno()

    def close(self):
        self.link.close()


class Ground:
    def __init__(self, autopilot="px4", swallow=None):
        spec = with_autopilot(get_vehicle("quad"), autopilot)
        self.vehicle = SimVehicle(spec, HOME, autopilot=get_autopilot(autopilot))
        simulation = Simulation([self.vehicle])
        link = simulation.open_link()
        self.texts = []
        self.link = Swallowing(link, *(swallow or (-1, 0)))
        self.driver = TransferDriver(
            MavlinkEndpoint(self.link, 255, 190),
            clock=link.clock,
            wait=lambda _link, seconds: link.wait(link, seconds),
            on_text=lambda message, _now_s: self.texts.append(str(message.text)),
        )
        self.driver.wait_for_vehicle()

    def holds(self):
        return self.driver.download(types=KINDS)[0]


def outside(texts):
    return [text for text in texts if "Geofence violation" in text]


def test_our_px4_checks_its_mission_against_a_new_fence_as_the_real_one():
    ground = Ground()
    ground.driver.upload(OLD)
    assert not outside(ground.texts)
    ground.driver.upload(NEW, types=[MissionType.FENCE])
    ground.driver.mission_state()
    assert outside(ground.texts) == ["Geofence violation for waypoint 3"]


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(("first", "second"), [(OLD, NEW), (NEW, OLD)])
def test_the_old_mission_is_not_checked_against_the_new_fence(autopilot, first, second):
    ground = Ground(autopilot)
    for mission in (first, second):
        ground.driver.upload(mission)
        ground.driver.mission_state()
        assert not outside(ground.texts)
        held = ground.holds()
        assert (len(held.items), len(held.fence)) == (4, 4)


@pytest.mark.parametrize("swallow", [0, 3, 6, 8])
def test_an_upload_that_breaks_off_leaves_no_mission_under_a_fence_that_is_not_its_own(swallow):
    """It may leave none, with the old fence or the new one; a mission is only there with its own fence."""
    ground = Ground(swallow=(m.MAVLINK_MSG_ID_MISSION_ITEM_INT, 10**6))
    ground.driver.upload(OLD)
    ground.link.after = swallow
    whole = swallow >= 8
    if whole:
        ground.driver.upload(NEW)
    else:
        with pytest.raises(TransferError, match="cleared before the upload: the vehicle holds no mission"):
            ground.driver.upload(NEW)
    ground.link.after = 10**6
    held = ground.holds()
    assert held.fence, "it had a fence"
    assert bool(held.items) == whole
    assert not outside(ground.texts)


def test_a_vehicle_that_armed_since_it_was_heard_keeps_its_mission():
    """The heartbeats that say so still wait on the link when the upload begins."""
    ground = Ground()
    ground.driver.upload(OLD)
    assert not ground.driver.vehicle.armed
    ground.vehicle.pilot.set_mode(Mode.MISSION)
    ground.vehicle.pilot.arm()
    for _ in range(12):
        ground.link.link.wait(ground.link.link, 0.25)
    ground.link.kind, ground.link.after = m.MAVLINK_MSG_ID_MISSION_ITEM_INT, 2
    with pytest.raises(TransferError, match="upload of the fence") as error:
        ground.driver.upload(NEW)
    assert "cleared" not in str(error.value)
    assert ground.driver.vehicle.armed


def none_of_ours(*plan, **options):
    return VerifiedUpload(*plan, **options)


@pytest.mark.parametrize(
    ("real", "total", "maker", "clears"),
    [
        (True, 3, OWN_TRANSFERS, True),
        (True, None, OWN_TRANSFERS, True),  # It may hold one that it has not told of
        (True, 0, OWN_TRANSFERS, False),
        (False, 3, OWN_TRANSFERS, True),
        (False, None, OWN_TRANSFERS, False),  # A simulated vehicle tells what it holds
        (True, 3, TransferMaker(none_of_ours, MissionDownload), False),
    ],
)
def test_what_a_vehicle_holds_is_cleared_where_it_may_hold_something(real, total, maker, clears):
    contact = Contact((1, 1), is_real=real, maker=maker)
    beat = m.MAVLink_heartbeat_message(2, m.MAV_AUTOPILOT_PX4, 1, 0, 3, 3)
    current = m.MAVLink_mission_current_message(0, 65535 if total == 0 else total or 0)
    for message in (beat, current):
        message.pack(m.MAVLink(None, 1, 1))
        contact.receive(message, 1.0)
    assert contact.monitor.state.total == total
    sent = [message.get_type() for message in PlanUploads(NEW, contact).start(1.0)]
    assert sent[0] == ("MISSION_CLEAR_ALL" if clears else "MISSION_COUNT")


class Losing:
    """A component whose messages of one kind are lost after so many of them."""

    def __init__(self, component, kind, after):
        self._component, self._kind, self._after = component, kind, after

    def __getattr__(self, name):
        return getattr(self._component, name)

    def _kept(self, messages):
        kept = []
        for message in messages:
            counts = message.get_msgId() == self._kind
            self._after -= counts
            if not counts or self._after >= 0:
                kept.append(message)
        return kept

    def receive(self, message, now_s):
        return self._kept(self._component.receive(message, now_s))

    def poll(self, now_s):
        return self._kept(self._component.poll(now_s))


@pytest.mark.parametrize(
    ("mission", "kind", "after", "said"),
    [
        (NEW, m.MAVLINK_MSG_ID_MISSION_ITEM_INT, 2, True),  # In the fence
        (NEW, m.MAVLINK_MSG_ID_MISSION_ITEM_INT, 6, True),  # In the mission
        (NEW, m.MAVLINK_MSG_ID_MISSION_CLEAR_ALL, 0, False),  # Nothing was cleared
        (Mission(NEW.items, HOME), m.MAVLINK_MSG_ID_MISSION_ITEM_INT, 2, False),  # Nothing is to be cleared
    ],
)
def test_the_ground_station_says_when_the_vehicle_is_left_without_a_mission(mission, kind, after, said):
    vehicle = Ground()
    vehicle.driver.upload(OLD)
    vehicle.link.close()
    station = GroundStation(mission, arming_gate=ArmingGate((1, 1), agreed=True))
    flight = Simulation([vehicle.vehicle, Losing(station, kind, after)])
    flight.run(until=lambda _now_s: station.done, limit_s=300.0)
    assert station.outcome is not Outcome.COMPLETED
    assert ("the old mission was cleared before the upload: the vehicle holds" in station.reason) is said
    assert not vehicle.vehicle.pilot.armed
