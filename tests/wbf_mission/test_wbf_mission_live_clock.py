"""A vehicle whose clock runs faster than ours, as a simulator at five times real time: on a virtual clock."""

import contextlib

from stand_in import scenario

from mission.ground.arming_gate import ArmingGate
from mission.outcome import Outcome
from mission.transfer import OWN_TRANSFERS
from mission.transfer.vehicles import Vehicle
from sim_vehicle.host.simulation import Simulation
from wbf_mission.flight import fly
from wbf_mission.live.discovery import fitted_to
from wbf_mission.live.hosting import riding_camera
from wbf_mission.simulator import make_components

SPEED = 5.0
BUDGET_S = 100.0


class Slower:
    """A component of the ground, whose clock runs slower than the vehicle's."""

    def __init__(self, inner):
        self.inner = inner
        self.system_id, self.component_id, self.wanted = inner.system_id, inner.component_id, inner.wanted

    def receive(self, message, now_s):
        return self.inner.receive(message, now_s / SPEED)

    def poll(self, now_s):
        return self.inner.poll(now_s / SPEED)

    def next_deadline(self):
        return SPEED * self.inner.next_deadline()


class FastVehicle:
    """A link to a vehicle, and its hosting, without sockets."""

    def __init__(self, made):
        self.made = made
        self.pace, self.tlog, self.transfers, self.force = None, None, OWN_TRANSFERS, False
        self.orders, self.waits_for_decisions = None, True
        self.console = self
        self.faults, self.full, self.change_s, self.changer = (), 1.0, 60.0, self

    # The link.

    def fitted(self, chosen, events):
        return fitted_to(chosen, Vehicle(1, 1, 3, 2))

    def numbered(self, vehicles):
        return tuple(vehicles)

    def check(self, campaign, events):
        return

    def hosting(self, faults):
        return self

    def tend(self, flight):
        assert flight.now_s < 600.0, "it does not end"

    # The hosting.

    def arming_gate(self, system_id):
        return ArmingGate((system_id, 1), agreed=True)

    def open(self, sorties, writer, **more):
        (sortie,) = sorties
        self.ground = Slower(sortie.ground)
        self.simulation = Simulation([*self.made.components, Slower(riding_camera(sortie)), self.ground])
        return contextlib.nullcontext(self)

    # The host.

    frames = 0

    @property
    def now_s(self):
        return self.simulation.now_s / SPEED

    def run(self, until, limit_s):
        return self.simulation.run(until=lambda now_s: until(now_s / SPEED), limit_s=SPEED * limit_s)

    def send(self, component, messages):
        self.simulation.send(self.ground, messages)


def test_a_policy_keeps_the_budget_of_a_vehicle_whose_clock_runs_faster():
    given = {"autopilot": "ardupilot", "policy": "confidence-guided", "budget": f"{BUDGET_S:g}s"}
    given["farm"] = "miniberry-30"
    link = FastVehicle(make_components(scenario(**given), with_camera=False))
    result = fly(scenario(**given), by=link)
    assert result.outcome is Outcome.COMPLETED, result.reason
    (flight,) = result.flights
    changes = [one for record in result.decisions for one in record.changes if one.outcome == "flown"]
    assert changes, "it decides in flight"
    assert 0.6 * BUDGET_S < flight.flight_time_s < 1.15 * BUDGET_S
    assert flight.camera.images > 20
