"""Our simulator in the place of a real vehicle: over real sockets, in a thread of its own."""

import contextlib
import threading
import time

from mission.outcome import Phase
from sim_vehicle.host.server import Server
from wbf_mission.addons.base.simulator import make_components
from wbf_mission.events import EventStream
from wbf_mission.scenario import Scenario

LONG_S = 120.0  # a limit against hanging, not a measure


class Nobody:
    """An operator who has agreed beforehand, as --yes does, and looks on."""

    def tend(self, flight):
        pass


class Watcher:
    """An operator who agrees to the start, and does something once when a vehicle has taken enough images."""

    def __init__(self, *, agrees=True, act=None, images=10, vehicle=1):
        self.agrees, self.act, self.images, self.vehicle = agrees, act, images, vehicle
        self.acted, self.phases, self.began_s = False, [], time.monotonic()

    def tend(self, flight):
        told = [(one.system_id, one.ground.phase, one.ground.pilot.mode) for one in flight.sorties]
        assert time.monotonic() < self.began_s + LONG_S, f"the flight does not end: {told}"
        for sortie in flight.sorties:
            phase, gate = sortie.ground.phase, sortie.ground.arming_gate
            if phase not in self.phases:
                self.phases.append(phase)
            if phase is Phase.READY:
                gate.agree() if self.agrees else gate.refuse()
            has_seen = sortie.assembler.statistics.images >= self.images
            is_due = sortie.system_id == self.vehicle and phase is Phase.FLIGHT and has_seen
            if is_due and self.act is not None and not self.acted:
                self.acted = True
                self.act(flight)


def scenario(**more):
    given = {"farm": "miniberry-10", "planner": "lawnmower", "budget": "60s", "estimator": "point"}
    if "policy" in more:
        del given["planner"]
    return Scenario(**{**given, **more})


def heard(*kinds):
    """Return a stream of events, and the list that takes those of some kinds."""
    events, told = EventStream(), []
    events.listen(told.append, *kinds)
    return events, told


@contextlib.contextmanager
def stand_in(
    autopilot="px4",
    *,
    camera=False,
    count=None,
    cold=False,
    speed=10.0,
    first_system=1,
    system_faults=(),
    homes=(),
    listen="tcpin:127.0.0.1:0",
    server=Server,
    **more,
):
    """Serve a simulated vehicle from another thread, over TCP by default; yields its address and it."""
    given = scenario(autopilot=autopilot, **more)
    made = make_components(
        given, with_camera=camera, count=count, cold=cold, first_system=first_system, homes=homes
    )
    with server(made.components, [listen], speed=speed, faults=system_faults) as serving:
        thread = threading.Thread(target=serving.run, daemon=True)
        thread.start()
        try:
            yield serving.urls[0].replace("tcpin", "tcp"), made
        finally:
            serving.stop()
            thread.join(LONG_S)
