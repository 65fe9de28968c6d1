"""A program that stands still before the start: a suspended laptop, a stopped process."""

import pytest
from mission_items import SHORT as MISSION

from mission.ground.arming_gate import LIFE_S, ArmingGate, Stage
from mission.ground.modes import Maneuver
from mission.ground.station import GroundStation
from mission.link.codec.dialect import mavlink as m
from mission.outcome import Outcome, Phase
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle

HOME = MISSION.home


class Suspended(GroundStation):
    """A ground station whose program stands still once, as soon as it has reached a phase or a stage."""

    def __init__(self, at, stood_s, *, agreed=True, loses_ack=0):
        gate = ArmingGate((1, 1), agreed=agreed, clock=lambda: self.now_s + self.stood_s)
        self.now_s = self.stood_s = 0.0
        self.at, self.stands_s, self.loses_ack, self.armed, self.started = at, stood_s, loses_ack, [], []
        super().__init__(MISSION, arming_gate=gate)

    def receive(self, message, now_s):
        lost = message.get_type() == "COMMAND_ACK" and message.command == self.loses_ack
        return [] if lost else self._sent(super().receive(message, now_s), now_s)

    def poll(self, now_s):
        self.now_s = now_s
        return self._sent(super().poll(now_s), now_s)

    def _sent(self, out, now_s):
        self.now_s = now_s
        for message in out:
            command = getattr(message, "command", None)
            if command == m.MAV_CMD_COMPONENT_ARM_DISARM:
                self.armed.append((self.stood_s > 0.0, message.param1))
            if command == m.MAV_CMD_MISSION_START:
                self.started.append(self.stood_s > 0.0)
        if self.at in (self.phase, self.arming_gate.stage):
            self.stood_s = self.stands_s
        return out

    def fly(self, until=lambda _now_s: False):
        vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=get_autopilot("ardupilot"))
        simulation = Simulation([vehicle, self])
        simulation.run(lambda now_s: self.done or until(now_s), limit_s=400.0)
        return simulation


@pytest.mark.parametrize("at", [Phase.CONTACT, Phase.UPLOAD, Phase.MODE, Phase.READY, Stage.GRANTED])
def test_an_agreement_does_not_outlive_a_standstill(at):
    ground = Suspended(at, LIFE_S + 1.5)
    ground.fly()
    assert ground.outcome is Outcome.NOT_STARTED
    assert ground.reason.startswith("the program stood still for ")
    assert "look at the vehicle, and start again" in ground.reason
    assert (ground.armed, ground.started) == ([], [])


def test_a_vehicle_that_was_being_armed_is_disarmed_and_not_started():
    ground = Suspended(Phase.ARM, 30.0)
    ground.fly()
    assert ground.outcome is Outcome.NOT_STARTED
    assert (ground.armed[0], set(ground.armed[1:])) == ((False, 1.0), {(True, 0.0)})
    assert ground.started == [] and "its motors may run" not in ground.reason


@pytest.mark.parametrize(
    ("loses", "outcome"), [(0, Outcome.COMPLETED), (m.MAV_CMD_MISSION_START, Outcome.NO_ANSWER)]
)
def test_an_order_to_start_counts_if_it_was_given_in_time_and_is_not_repeated(loses, outcome):
    ground = Suspended(Phase.START, 30.0, loses_ack=loses)
    ground.fly()
    assert (ground.outcome, ground.started) == (outcome, [False])


def test_who_was_not_asked_yet_is_asked_after_the_standstill():
    ground = Suspended(Stage.ASKING, 30.0, agreed=False)
    simulation = ground.fly(lambda now_s: ground.stood_s > 0.0 and now_s > 20.0)
    assert ground.arming_gate.stage is Stage.ASKING
    ground.arming_gate.agree()
    simulation.run(lambda _now_s: ground.done, limit_s=400.0)
    assert ground.outcome is Outcome.COMPLETED


def test_a_slow_machine_does_not_stand_still():
    ground = Suspended(Phase.READY, LIFE_S - 1.1)
    ground.fly()
    assert ground.outcome is Outcome.COMPLETED


@pytest.mark.parametrize(("stood_s", "orders"), [(0.0, 4), (30.0, 1)])
def test_an_order_in_flight_is_not_repeated_after_a_standstill(stood_s, orders):
    ground = Suspended(None, stood_s)
    simulation = ground.fly(lambda now_s: ground.phase is Phase.FLIGHT and now_s > 15.0)
    ground.loses_ack, sent = m.MAV_CMD_DO_SET_MODE, ground.maneuver(Maneuver.HOLD, simulation.now_s)
    ground.stood_s = stood_s
    for _ in range(300):
        ground.now_s += 0.1
        out = ground.poll(ground.now_s)
        sent += [one for one in out if getattr(one, "command", None) == sent[0].command]
        assert (ground.now_s - ground._monitor.mode_heard_s > LIFE_S) or stood_s == 0.0
        assert ground.is_told_anew is (stood_s == 0.0), "mode and item are from before the standstill"
    assert len(sent) == orders
    assert "the vehicle did not take the order" in ground.texts[-1][2]
