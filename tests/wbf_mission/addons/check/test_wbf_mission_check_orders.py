"""The conformance kit on a stand-in for a real PX4: slow, busy for seconds, late with what it says."""

import heapq
import random
from itertools import count

import pytest
from sweeps import slow

from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.check import check_vehicle, runner
from wbf_mission.addons.check.runner import chosen_checks

HOME = GeoPoint(28.05, -82.15, 20.0)
BUSY_S = 5.0
# They failed in some full runs on a real PX4 1.17, and passed alone.
FAILED_BY_CHANCE = (
    "mission.clear-all",
    "transfer.cancel-download",
    "transfer.old-plan-kept",
    "transfer.second-station",
)


class RealPx4(SimVehicle):
    """A PX4 as the real one behaves at the edges of a transfer.

    After a COUNT of 0, and where the last ACK of a download gets lost, it answers every COUNT with ERROR and
    no CLEAR_ALL at all until its timeout of 5 s.
    """

    def __init__(self, chance):
        super().__init__(get_vehicle("quad"), HOME)
        self.chance, self.busy_until_s, self.lost = chance, -1.0, 0

    def receive(self, message, now_s):
        kind = message.get_type()
        ours = getattr(message, "target_system", None) == 1
        if ours and kind == "MISSION_COUNT" and now_s < self.busy_until_s:
            source = message.get_srcSystem(), message.get_srcComponent()
            return [m.MAVLink_mission_ack_message(*source, m.MAV_MISSION_ERROR, message.mission_type)]
        if ours and kind == "MISSION_CLEAR_ALL" and now_s < self.busy_until_s:
            return []
        if ours and kind == "MISSION_COUNT" and message.count == 0:
            self.busy_until_s = now_s + BUSY_S
        ends = ours and kind == "MISSION_ACK" and message.type == m.MAV_MISSION_ACCEPTED
        if ends and self.chance.random() < 0.15:
            self.lost += 1
            self.busy_until_s = now_s + BUSY_S
        return super().receive(message, now_s)


class Late:
    """The ground's end of the link: what the vehicle sends comes late, its texts seconds later."""

    def __init__(self, link, chance, answers_s, texts_s):
        self.link, self.name, self.clock, self.chance = link, link.name, link.clock, chance
        self.answers_s, self.texts_s = answers_s, texts_s
        self._order, self._flying, self._last_s = count(), [], 0.0

    def send(self, data):
        self.link.send(data)

    def _take(self):
        for data in self.link.receive():
            now_s = self.clock()
            # In the order in which they were sent, but texts.
            self._last_s = max(self._last_s, now_s + self.answers_s * self.chance.random())
            text = int.from_bytes(data[7:10], "little") == m.MAVLINK_MSG_ID_STATUSTEXT
            due_s = now_s + self.texts_s * self.chance.random() if text else self._last_s
            heapq.heappush(self._flying, (due_s, next(self._order), data))

    def receive(self):
        self._take()
        arrived = []
        while self._flying and self._flying[0][0] <= self.clock():
            arrived.append(heapq.heappop(self._flying)[2])
        return arrived

    def fileno(self):
        return None

    def wait(self, _link, seconds):
        self._take()
        if self._flying:
            seconds = min(seconds, max(self._flying[0][0] - self.clock(), 0.0))
        self.link.wait(self.link, seconds)

    def close(self):
        self.link.close()


def bad_checks(checks, monkeypatch, seed, answers_s=0.4):
    """Run the checks in this order; those that fail, with what they say."""
    chance = random.Random(seed)
    monkeypatch.setattr(runner, "chosen_checks", lambda *_args, **_options: tuple(checks))
    link = Late(Simulation([RealPx4(chance)]).open_link(), chance, answers_s, 3.0)
    report = check_vehicle(link, clock=link.clock, wait=link.wait)
    assert not report.warnings
    return [(one.check.id, one.detail) for one in report.results if one.bad]


CHECKS = chosen_checks(("mission", "transfer"), fly=False)


@pytest.mark.parametrize("seed", [slow(0), 1])
def test_in_any_order_of_the_checks_all_pass(seed, monkeypatch):
    checks = list(CHECKS)
    if seed:
        random.Random(seed).shuffle(checks)
    assert bad_checks(checks, monkeypatch, seed) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 10))
def test_in_many_orders_of_the_checks_all_pass(seed, monkeypatch):
    checks = list(CHECKS)
    random.Random(seed).shuffle(checks)
    assert bad_checks(checks, monkeypatch, seed, answers_s=0.1 * (seed % 8)) == []


@pytest.mark.parametrize("name", FAILED_BY_CHANCE)
def test_those_that_failed_by_chance_pass_after_what_leaves_a_px4_busy(name, monkeypatch):
    known = {one.id: one for one in CHECKS}
    before = ("transfer.count-zero", "transfer.out-of-order", "transfer.re-read", "transfer.too-many")
    checks = [known[one] for first in before for one in (first, name)]
    assert bad_checks(checks, monkeypatch, 5) == []
