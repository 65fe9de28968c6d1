"""Our simulator in the place of a real vehicle: over real sockets, in a thread of its own."""

import contextlib
import threading

from sim_vehicle.host.server import Server
from wbf_mission.addons.base.simulator import make_components
from wbf_mission.events import EventStream
from wbf_mission.scenario import Scenario

LONG_S = 120.0  # a limit against hanging, not a measure


class Nobody:
    """An operator who has agreed beforehand, as --yes does, and looks on."""

    def tend(self, flight):
        pass


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
    **more,
):
    """Serve a simulated vehicle from another thread, over TCP by default; yields its address and it."""
    given = scenario(autopilot=autopilot, **more)
    made = make_components(
        given, with_camera=camera, count=count, cold=cold, first_system=first_system, homes=homes
    )
    with Server(made.components, [listen], speed=speed, faults=system_faults) as server:
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        try:
            yield server.urls[0].replace("tcpin", "tcp"), made
        finally:
            server.stop()
            thread.join(LONG_S)
