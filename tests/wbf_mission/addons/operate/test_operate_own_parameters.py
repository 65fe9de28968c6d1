"""A connected vehicle is planned and predicted with the parameters that are set on it."""

import pytest
from stand_in import Nobody, heard, scenario

from mission.outcome import Outcome
from wbf_mission.addons.operate.link import LiveLink
from wbf_mission.events import Found, Noted
from wbf_mission.flight import fly
from wbf_mission.planning.builder import budget_left


@pytest.mark.parametrize(
    ("autopilot", "parameters"),
    [
        ("px4", {"MPC_LAND_SPEED": 0.6, "RTL_LAND_DELAY": 20.0}),
        ("ardupilot", {"RTL_ALT": 4000, "RTL_CONE_SLOPE": 0.0, "LAND_SPEED": 30}),
    ],
)
def test_its_return_and_landing_count_in_the_predicted_time(quick_stand_in, autopilot, parameters):
    events, told = heard(Noted)
    given = {"budget": "3min"}
    with quick_stand_in(autopilot, parameters=parameters, **given) as (url, _):
        result = fly(scenario(**given), by=LiveLink(url, Nobody(), agreed=True), events=events)
    assert result.outcome is Outcome.COMPLETED
    predicted_s = result.plan.prediction.duration_s
    assert result.flight_time_s == pytest.approx(predicted_s, rel=0.1)
    told = [note.text for note in told]
    said = [text for text in told if "planned with the vehicle's parameters" in text]
    assert len(said) == 1
    assert all(f"{name} {value:g}" in said[0] for name, value in parameters.items())
    assert result.plan.prediction.duration_s <= 180.0, "the budget pays for it, too"
    assert (left := budget_left([result.plan])) == "" or left in told


def test_in_a_fleet_one_that_leaves_its_layer_is_predicted_so_and_warned_of(quick_stand_in):
    events, found = heard(Found)
    given = {"budget": "2min", "separation": "layers:3m"}
    high = {"RTL_RETURN_ALT": 40.0, "RTL_CONE_ANG": 0}
    with (
        quick_stand_in("px4", parameters={"RTL_RETURN_ALT": 10.0}) as (one, _),
        quick_stand_in("px4", first_system=2, parameters=high) as (two, _),
    ):
        link = LiveLink([one, two], Nobody(), agreed=True)
        result = fly(scenario(**given), by=link, events=events)
    assert result.outcome is Outcome.COMPLETED
    assert [each.vehicle for each in found if each.code == "other-return"] == ["vehicle 2: "]
    highest = [flight.plan.prediction.track_m[:, 2].max() for flight in result.flights]
    assert highest[0] < 16.0 and highest[1] == pytest.approx(40.0, abs=1.0)
    for flight in result.flights:
        assert flight.flight_time_s == pytest.approx(flight.plan.prediction.duration_s, rel=0.1)
