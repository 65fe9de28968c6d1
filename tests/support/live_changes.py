"""A real vehicle's mission changed in flight, on the virtual clock, over a link that breaks."""

import math

import numpy as np

from geo.farms import get_farm
from geo.frame import LocalFrame
from mission.ground.arming_gate import ArmingGate
from mission.ground.items import revised_mission
from mission.ground.station import GroundStation
from mission.model import GeoPoint, Mission, MissionItem
from mission.outcome import Phase
from sensors.camera.leaf_camera import LeafCamera
from sensors.camera.wire import ObservationAssembler
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot, with_autopilot
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.operate.riding_camera import RidingCamera

HOME = GeoPoint(28.05, -82.15)
FRAME = LocalFrame(28.05, -82.15)
HEIGHT_M = 12.0
OLD = ((0.0, 20.0), (60.0, 20.0), (60.0, 35.0), (0.0, 35.0))
LONG = tuple((60.0 * (row % 4 in (1, 2)), 20.0 + 5.0 * (row // 2)) for row in range(24))
NEW = ((40.0, 60.0), (-20.0, 60.0))
CHANGE_AT = 5
"""The item that is flown to when the mission is changed."""
_PROTOCOL = ("MISSION_", "COMMAND_", "PARAM_")
# What comes after the mission takes as long as half of it.
LANDS_SOON = {
    "px4": {"RTL_RETURN_ALT": 14.0, "RTL_DESCEND_ALT": 5.0, "MPC_LAND_ALT1": 5.0, "MPC_LAND_SPEED": 1.5},
    "ardupilot": {"RTL_LOIT_TIME": 0.0, "LAND_ALT_LOW": 500.0, "LAND_SPEED": 100.0},
}


def degrees(points):
    return [FRAME.to_wgs84(float(x), float(y)) for x, y in points]


def planned(points=OLD, image_m=4.0, radius_m=2.0):
    through = [MissionItem.waypoint(*one, HEIGHT_M, acceptance_radius_m=radius_m) for one in degrees(points)]
    items = (
        MissionItem(22, 3, 0, 0, 0, None, HOME.latitude_deg, HOME.longitude_deg, HEIGHT_M),
        MissionItem(178, param1=1.0, param2=5.0, param3=-1.0),
        through[0],
        MissionItem(206, param1=image_m, param3=1.0),
        *through[1:],
        MissionItem(206),
        MissionItem(20),
    )
    return Mission(items, HOME)


def keys(mission):
    return tuple((item.command, item.x, item.y) for item in mission.items)


class SameEverywhere:
    """An environment."""

    def sample(self, day, ix, iy):
        return np.zeros((len(ix), 3), dtype=np.float32)


class Breaking:
    """A component behind a link that breaks after so many messages of a change have crossed it."""

    def __init__(self, inner, link):
        self.inner, self._link = inner, link
        self.system_id, self.component_id, self.wanted = inner.system_id, inner.component_id, inner.wanted

    def receive(self, message, now_s):
        if not self._link.crosses([message], now_s):
            return []
        return self._link.crosses(self.inner.receive(message, now_s), now_s)

    def poll(self, now_s):
        return self._link.crosses(self.inner.poll(now_s), now_s)

    def next_deadline(self):
        return self.inner.next_deadline()


class BreakingLink:
    """Counts the messages of a change, and breaks after one of them for a while or for good."""

    def __init__(self, after, dead_s):
        self.after, self.dead_s = after, dead_s
        self.changing = False
        self.crossed = []
        self.broke_s = math.inf

    def is_dead(self, now_s):
        return self.broke_s <= now_s < self.broke_s + self.dead_s

    def crosses(self, messages, now_s):
        """Return those messages that get across."""
        arrived = []
        for message in messages:
            if self.is_dead(now_s):
                continue
            arrived.append(message)
            if self.changing and message.get_type().startswith(_PROTOCOL):
                self.crossed.append(message.get_type())
                if len(self.crossed) == self.after:
                    self.broke_s = now_s
        return arrived


class LiveChange:
    """One flight: the mission is changed once, and the link breaks after the n-th message of that."""

    def __init__(
        self,
        autopilot,
        *,
        after=None,
        dead_s=40.0,
        impairment=None,
        old=OLD,
        new=NEW,
        on_board=False,
        change_at=CHANGE_AT,
        near_m=math.inf,
        image_m=4.0,
        lands_soon=False,
    ):
        self.change_at, self.near_m = change_at, near_m
        spec = with_autopilot(get_vehicle("quad"), autopilot, LANDS_SOON[autopilot] if lands_soon else {})
        farm = get_farm("miniberry-10")
        self.vehicle = SimVehicle(spec, HOME, autopilot=get_autopilot(autopilot))
        self.link = BreakingLink(after, dead_s)
        self.assembler = ObservationAssembler(farm, day=1)
        gate = ArmingGate((1, 1), agreed=True)
        self.old = planned(old, image_m)
        self.station = GroundStation(self.old, self.assembler, arming_gate=gate)
        optics = LeafCamera(SameEverywhere(), farm.grid().shape, 1)
        camera = LeafCameraComponent(optics, farm)
        near, far = [self.vehicle, camera], [Breaking(self.station, self.link)]
        if not on_board:
            self.camera = RidingCamera(camera, lambda: self.station.mission, lambda: self.station.changing)
            near, far = [self.vehicle], [*far, Breaking(self.camera, self.link)]
        self.simulation = Simulation([*near, *far], impairment=impairment, remote=far if impairment else ())
        self.lists = set()
        self.modes = []
        self.new, self._points = None, new

    def fly(self, limit_s=900.0):
        self.simulation.run(until=self._look, limit_s=limit_s)
        return self

    def to_images(self, count):
        """Fly until so many images have come."""
        seen = self.assembler.statistics
        self.simulation.run(until=lambda _now_s: seen.images >= count, limit_s=300.0)
        assert seen.images >= count
        return self

    def _look(self, now_s):
        station, pilot = self.station, self.vehicle.pilot
        if (
            self._points
            and self.new is None
            and station.phase is Phase.FLIGHT
            and station.vehicle_state.item == self.change_at
            and self._left_m() < self.near_m
        ):
            self.new, resume_at = revised_mission(
                station.mission,
                self.change_at,
                degrees(self._points),
                altitude_m=HEIGHT_M,
                acceptance_radius_m=2.0,
            )
            self.link.changing = True
            begun = station.change(self.new, resume_at, now_s)
            self.simulation.send(station, self.link.crosses(begun, now_s))
        if self.link.changing and self.new is not None and not station.changing and station.changes:
            self.link.changing = False
        if not self.modes or self.modes[-1] is not pilot.mode:
            self.modes.append(pilot.mode)
        if pilot.armed and pilot.mode is Mode.MISSION:
            self.lists.add(tuple((item.command, item.x, item.y) for item in pilot.mission.items))
        if math.isinf(self.link.dead_s) and self.link.is_dead(now_s):
            return not pilot.armed
        return station.done

    def _left_m(self):
        """How far the vehicle is from its target, as the ground knows it."""
        target = self.old.items[self.change_at]
        return math.dist(FRAME.from_wgs84(target.x, target.y), self.station.vehicle_state.position_m(FRAME))

    def check_safe(self):
        """One whole plan was flown, never a mixture, and it came home."""
        whole = {keys(self.old)} | ({keys(self.new)} if self.new else set())
        assert self.lists <= whole, "a mixture of two plans was flown"
        x, y, z = self.vehicle.pilot.state.position_m
        assert math.hypot(x, y) < 3.0, (self.modes, self.station.changes)
        assert z < 0.2
        assert not self.vehicle.pilot.armed, (self.modes, self.station.changes)
