"""The reserve of a battery: no real vehicle starts a sortie without it, and no policy plans it away."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stand_in import scenario

from mission.ground.vehicle_state import Battery
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.catalog import get_vehicle, vehicle_names
from wbf_mission.addons.operate import link as live
from wbf_mission.addons.operate.console import TerminalConsole
from wbf_mission.addons.operate.link import LiveLink
from wbf_mission.addons.operate.real_sorties import REAL_FULL, BatteryWait, needed_fraction
from wbf_mission.addons.operate.watching import WatchedVehicle
from wbf_mission.cli.output import Output
from wbf_mission.planning import MissionBuilder
from wbf_mission.planning.budget import ReserveCharge, make_budget
from wbf_mission.run.plan import plan
from wbf_mission.run.sortie import Sortie

parts = st.floats(0.01, 0.99)


@pytest.fixture(scope="module")
def planned():
    return plan(scenario(vehicle="quad"))


def taking(planned, part, *, mean=1.0, capacity_wh=50.0, reserve=0.2):
    """Return a plan whose flight takes at most a part of its battery, and on average `mean` of that."""
    held = {"capacity_wh": capacity_wh, "reserve_fraction": reserve, "critical_fraction": 0.0}
    battery = replace(planned.vehicle.battery, **held)
    most_wh = part * capacity_wh
    prediction = replace(
        planned.prediction,
        energy_wh=mean * most_wh,
        energy_bound_wh=most_wh,
        battery_fraction=1.0 - mean * part,
    )
    return replace(planned, vehicle=replace(planned.vehicle, battery=battery), prediction=prediction)


def read(percent):
    vehicle = WatchedVehicle((1, 1))
    vehicle.receive(m.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3), 0.0)
    cells = [65535] * 10
    vehicle.receive(m.MAVLink_battery_status_message(0, 0, 0, 32767, cells, -1, -1, -1, percent), 0.0)
    return vehicle


@settings(deadline=None)
@given(part=parts, mean=parts, reserve=st.floats(0.01, 0.5), capacity_wh=st.floats(1.0, 500.0))
def test_a_battery_that_is_enough_comes_home_with_its_reserve(planned, part, mean, reserve, capacity_wh):
    needs = needed_fraction(taking(planned, part, mean=mean, capacity_wh=capacity_wh, reserve=reserve))
    left_wh = needs * capacity_wh - part * capacity_wh
    assert left_wh == pytest.approx(reserve * capacity_wh)


def test_a_vehicle_without_a_battery_needs_none(planned):
    assert needed_fraction(replace(planned, vehicle=replace(planned.vehicle, battery=None))) is None


@settings(deadline=None)
@given(part=st.floats(0.05, 0.75), risen=parts, percent=st.integers(0, 100), alone=st.booleans())
def test_no_sortie_starts_with_less_than_it_takes_and_the_reserve(planned, part, risen, percent, alone):
    """With an operator who says that the battery is changed, and without."""
    needs = needed_fraction(taking(planned, part))
    wait = BatteryWait(needs, None if alone else lambda: True, risen, 60.0, lambda _text: None)
    starts = wait._settled(read(percent), 1.0) == ""
    assert starts is (percent / 100.0 >= part + 0.2 and (not alone or percent / 100.0 >= risen))


@pytest.mark.parametrize("agreed", [True, False])
def test_a_link_waits_for_what_the_next_plan_takes_and_the_reserve(planned, agreed, monkeypatch):
    waits = []

    class Wait(BatteryWait):
        def wait(self, url, system_id):
            waits.append((self.needs, self.asks is None, url, system_id))
            return ""

    monkeypatch.setattr(live, "BatteryWait", Wait)
    checked = []
    monkeypatch.setattr(LiveLink, "check_sent", lambda _link, given: checked.append(list(given)))
    link = LiveLink("tcp:there:1", TerminalConsole(Output()), agreed=agreed)
    link._heard = {1: ("tcp:there:1", None)}
    last = SimpleNamespace(battery_readings=(1.0, 0.5))
    vehicle, after = SimpleNamespace(task=SimpleNamespace(system_id=1)), taking(planned, 0.6)
    assert link.change_battery(vehicle, after, last=last, which="sortie 2 of 3") == ""
    assert waits == [(pytest.approx(0.8), agreed, "tcp:there:1", 1)]
    assert checked == [[(vehicle, after)]]


def test_a_battery_of_a_real_vehicle_is_never_full():
    """Batteries age: few that were just charged read more (docs/sorties.md)."""
    assert REAL_FULL == 0.95


@settings(deadline=None)
@given(part=parts, reserve=st.floats(0.01, 0.5))
def test_a_mission_is_too_long_for_a_battery_when_it_takes_of_the_reserve(planned, part, reserve):
    assert taking(planned, part, reserve=reserve).is_too_long is (1.0 - part < reserve)


@pytest.mark.parametrize("name", [one for one in vehicle_names() if get_vehicle(one).battery is not None])
def test_a_policy_spares_of_a_battery_what_telemetry_rounds(name, planned):
    """A battery is told in percent: decisions priced from it err by one, and by what is used meanwhile."""
    one = scenario(vehicle=name, policy="greedy", budget=None)
    builder = MissionBuilder.of(one, planned.farm)
    battery = builder.vehicle.battery
    usable_wh = battery.capacity_wh * (1.0 - battery.reserve_fraction)
    fixed, text = make_budget(None, builder)
    steered, spared = make_budget(None, builder, steered=True)
    assert fixed.unit == steered.unit == "Wh" and fixed.limit == pytest.approx(usable_wh)
    assert "of the rest" in spared and "of the rest" not in text
    assert 0.01 * battery.capacity_wh < fixed.limit - steered.limit < 0.05 * battery.capacity_wh


@settings(deadline=None)
@given(
    mean_wh=st.floats(0.5, 50.0),
    priced=st.floats(0.5, 1.5),
    calm=st.floats(0.5, 1.5),
    spread=st.floats(0.0, 0.5),
    rest=parts,
)
def test_what_is_charged_for_a_flight_and_its_rest_is_what_it_may_take(mean_wh, priced, calm, spread, rest):
    """The whole is charged its bound; a rest its mean, and more than its share of what is spread."""
    full = SimpleNamespace(energy_wh=mean_wh, most_wh=(1.0 + spread) * mean_wh)
    in_calm_air = SimpleNamespace(energy_wh=calm * mean_wh)
    builder = SimpleNamespace(
        predict=lambda _mission: full, price=lambda _missions, gusts: [full if gusts else in_calm_air]
    )
    charge = ReserveCharge(builder)
    charge.learn(None, priced * mean_wh)
    assert charge.factor * priced * mean_wh == pytest.approx(full.most_wh)
    assert charge.rest(calm * mean_wh) == pytest.approx(full.most_wh)
    of_rest = charge.rest(rest * calm * mean_wh)
    assert rest * full.most_wh - 1e-9 <= of_rest <= full.most_wh + 1e-9


def spent_wh(planned, before, now, *, limit_wh, flown_s=60.0):
    """Return what a policy is told that a real vehicle has spent, of a battery of 50 Wh and 10 Wh reserve."""
    ground = SimpleNamespace(
        arming_gate=object(),
        battery_before=Battery(*before),
        vehicle_state=SimpleNamespace(battery=Battery(*now)),
        started_s=0.0,
        flight_time_s=0.0,
    )
    task = SimpleNamespace(request=SimpleNamespace(budget=SimpleNamespace(limit=limit_wh, unit="Wh")))
    sortie = SimpleNamespace(ground=ground, task=task, plan=taking(planned, 0.5))
    sortie._mean_wh_s = sortie.plan.prediction.energy_wh / sortie.plan.prediction.duration_s
    sortie._drawn_wh = lambda seconds: Sortie._drawn_wh(sortie, seconds)
    return Sortie._spent(sortie, flown_s)


percents = st.integers(25, 100).map(lambda one: one / 100.0)


@settings(deadline=None)
@given(start=percents, drawn=st.floats(0.0, 12.0), boot_wh=st.floats(0.0, 30.0), tells=st.integers(1, 3))
def test_a_policy_on_a_real_vehicle_leaves_the_reserve_in_the_battery(planned, start, drawn, boot_wh, tells):
    """Whatever it tells: PX4 percent only, others energy since they booted, too."""
    drawn = min(drawn, 50.0 * start - 10.0)
    percent, energy = bool(tells & 1), bool(tells & 2)
    before = start if percent else None, boot_wh if energy else None
    left = math.ceil(100.0 * (start - drawn / 50.0) - 1e-9) / 100.0
    now = left if percent else None, boot_wh + drawn if energy else None
    spent = spent_wh(planned, before, now, limit_wh=40.0)
    assert spent >= drawn - (0.0 if energy else 0.5) - 1e-9, "a percent is rounded up"
    if percent:
        assert 40.0 - spent <= 50.0 * left - 10.0 + 1e-9, "what is left of the budget is above the reserve"
    # A budget that is less than the battery holds is that of this flight.
    assert spent_wh(planned, before, now, limit_wh=min(5.0, 50.0 * start - 10.0)) == pytest.approx(
        drawn, abs=0.51
    )


def test_a_vehicle_that_tells_nothing_of_its_battery_is_charged_as_planned(planned):
    prediction = taking(planned, 0.5).prediction
    half_s = 0.5 * prediction.duration_s
    spent = spent_wh(planned, (None, None), (None, None), limit_wh=40.0, flown_s=half_s)
    assert spent == pytest.approx(0.5 * prediction.energy_wh)


def test_an_autopilot_that_starts_again_in_flight_does_not_give_energy_back(planned):
    assert spent_wh(planned, (0.9, 8.0), (0.6, 0.0), limit_wh=20.0) == pytest.approx(15.0)
