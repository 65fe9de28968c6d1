"""Zones: the action of least expected cost, block by block."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import beta, norm
from sweeps import sweep

from geo import get_farm
from sensors.dynamics.continuous import Measured
from sensors.dynamics.soil import SoilParameters
from sensors.fields import ALL_CROPS, PAPER_FIELDS, Field, FieldSet
from wbf_mission.addons.treatment.gis import MapError
from wbf_mission.addons.treatment.treatment_map import (
    HEALTHY,
    LOOK,
    TREAT,
    FieldCosts,
    block_grid,
    costs_of,
    is_water,
    zone_map,
)
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import FieldMap
from wbf_mission.maps.report import brief, report_of_maps

COSTS = FieldCosts(treat=300.0, loss=4000.0, look=20.0)
CELLS = 100.0


PH = Field("ph", Measured(), (ALL_CROPS,), default=0.5, unit="pH", range=(4.0, 9.0))


def field_map(mean, deviation, *, field="tylcv", cells=CELLS):
    """Blocks in a row with these means and deviations of their shares."""
    mean = np.asarray(mean, np.float64)[:, None]
    grid = MapGrid((10 * len(mean), 10), 1.0, 10, 1)
    count = np.full(mean.shape, cells)
    variance = None
    if deviation is not None:
        variance = (np.asarray(deviation, np.float64)[:, None] * count) ** 2
    nothing = np.zeros(mean.shape)
    finds = np.empty((0, 2), np.int32)
    return FieldMap(
        field if isinstance(field, Field) else PAPER_FIELDS[field],
        grid,
        count,
        mean * count,
        mean,
        variance,
        nothing,
        nothing,
        finds,
        1.0,
    )


def expected_least(mean, deviation, limit):
    """E[min(limit, s)] by integration."""
    size = mean * (1.0 - mean) / deviation**2 - 1.0
    shares = beta(mean * size, (1.0 - mean) * size)
    # min(t, s) = s - (s - t)+, whose mean is the integral of the survival function.
    return mean - quad(shares.sf, limit, 1.0, limit=200)[0]


@sweep(few=25, many=200)
@given(st.floats(0.01, 0.9), st.floats(0.05, 0.9), st.floats(10.0, 3900.0))
def test_a_look_is_worth_the_expected_value_of_perfect_information(mean, part, treat):
    deviation = part * np.sqrt(mean * (1.0 - mean))
    costs = replace(COSTS, treat=treat)
    found = zone_map(field_map([mean], [deviation]), costs)
    best = min(treat, 4000.0 * mean)
    known = 4000.0 * expected_least(mean, deviation, treat / 4000.0)
    assert found.gain[0, 0] == pytest.approx(best - known, abs=0.05)
    actions = {HEALTHY: 4000.0 * mean, TREAT: treat, LOOK: costs.look + best - found.gain[0, 0]}
    assert actions[int(found.zone[0, 0])] == pytest.approx(min(actions.values()), abs=1e-6)


def test_a_continuous_field_is_treated_by_the_chance_that_it_is_too_low():
    means, deviation = [0.2, 0.39, 0.6], 0.05
    found = zone_map(field_map(means, [deviation] * 3, field="soil"), replace(COSTS, treat=2000.0))
    assert found.need[:, 0] == pytest.approx(norm.cdf((0.4 - np.array(means)) / deviation))
    assert found.zone[:, 0].tolist() == [TREAT, LOOK, HEALTHY]
    assert [found.word(one) for one in (TREAT, LOOK, HEALTHY)] == ["dry", "look again", "enough"]


def test_expected_costs_are_those_of_the_actions():
    found = zone_map(field_map([0.01, 0.5, 0.08], [0.0, 0.0, 0.1]), COSTS)
    area = CELLS / 1e4
    costs = found.expected_costs
    assert costs["leave"] == pytest.approx(4000.0 * 0.59 * area)
    assert costs["treat"] == pytest.approx(900.0 * area)
    looked = 20.0 + 300.0 - found.gain[2, 0]
    assert costs["zones"] == pytest.approx((40.0 + 300.0 + looked) * area)
    assert costs["known"] == pytest.approx((40.0 + 300.0 + looked - 20.0) * area)


def test_a_look_is_worth_what_betabinomial_outcomes_save():
    # One look at an all-or-nothing block tells all; at a block of independent plants nearly nothing.
    whole = zone_map(field_map([0.05], [np.sqrt(0.05 * 0.95)]), COSTS)
    assert whole.gain_of_looks(np.ones((1, 1))) == pytest.approx(float(whole.gain[0, 0]) / 100.0)
    one = zone_map(field_map([0.05], [0.02]), COSTS)
    assert one.gain_of_looks(np.ones((1, 1))) < 0.01 * float(one.gain[0, 0]) / 100.0


def test_costs_are_those_given_and_otherwise_the_scores():
    costs = costs_of(PAPER_FIELDS, {})
    assert costs["tylcv"] == FieldCosts(1.0, 11.0, 0.1)
    assert costs["soil"] == FieldCosts(0.1, 0.2, pytest.approx(0.01), rate=10.0, rate_unit="mm")
    given_costs = {
        "look": ["ccr=0"],
        "treat": ["100", "ccr=2e2"],
        "below": ["soil=0.55"],
        "rate": ["80 kg/ha"],
    }
    costs = costs_of(PAPER_FIELDS, given_costs)
    assert [one.treat for one in costs.values()] == [100.0, 200.0, 100.0]
    assert [one.look for one in costs.values()] == [10.0, 0.0, 10.0]
    assert [one.loss for one in costs.values()] == [1100.0, 2200.0, 200.0]
    assert costs["soil"].below == 0.55
    assert {(one.rate, one.rate_unit) for one in costs.values()} == {(80.0, "kg/ha")}


def test_what_is_not_given_keeps_its_proportion():
    costs = costs_of(PAPER_FIELDS, {"loss": ["tylcv=2200"], "treat": ["ccr=300"]})
    assert (costs["tylcv"].treat, costs["tylcv"].loss, costs["tylcv"].look) == (200.0, 2200.0, 20.0)
    assert (costs["ccr"].treat, costs["ccr"].loss) == (300.0, pytest.approx(3300.0))
    both = costs_of(PAPER_FIELDS, {"loss": ["4000"], "treat": ["300"]})["tylcv"]
    assert (both.treat, both.loss, both.look) == (300.0, 4000.0, 30.0)


@pytest.mark.parametrize(
    ("key", "text", "told"),
    [
        ("treat", "many", "--treat-cost many: 'many' is not a number; give"),
        ("treat", "mildew=3", "--treat-cost mildew=3: no field 'mildew'; the fields are tylcv, ccr, soil"),
        ("loss", "0", "--loss 0: out of range; give a number above 0"),
        ("look", "-1", "--look-cost -1: out of range; give a number 0 or more"),
        ("below", "1.5", "--low-below 1.5: soil lies in 0..1; give a number in this range"),
        ("treat", "3 EUR", "--treat-cost 3 EUR: '3 EUR' is not a number"),
    ],
)
def test_costs_that_make_no_sense_are_refused(key, text, told):
    with pytest.raises(MapError) as caught:
        costs_of(PAPER_FIELDS, {key: [text]})
    assert str(caught.value).startswith(told)


def test_blocks_are_what_a_sprayer_can_act_on():
    sides = {name: block_grid(get_farm(name)) for name in ("miniberry-10", "miniberry-100", "waterberry")}
    assert {name: grid.pixel for name, grid in sides.items()} == {
        "miniberry-10": 1,
        "miniberry-100": 3,
        "waterberry": 13,
    }
    assert block_grid(get_farm("waterberry"), 10.0).pixel == 33
    assert block_grid(get_farm("miniberry-10"), 500.0).pixels == (1, 1)


def test_only_of_soil_humidity_the_lack_is_water():
    nitrogen = Field(
        "nitrogen", SoilParameters(), (ALL_CROPS,), default=0.4, unit="kg/ha", range=(0.0, 200.0)
    )
    assert not is_water(nitrogen)
    assert is_water(PAPER_FIELDS["soil"])
    assert not is_water(PAPER_FIELDS["tylcv"])
    of = field_map([0.2], [0.0], field=nitrogen)
    assert zone_map(of, costs_of(FieldSet((nitrogen,)), {})["nitrogen"]).word(TREAT) == "too low"


def test_thresholds_and_reports_are_in_the_unit_of_their_field():
    costs = costs_of(FieldSet((PH,)), {"below": ["5.5"]})["ph"]
    assert costs_of(FieldSet((PH,)), {})["ph"].below == 6.0  # 0.4 of the way from 4 to 9
    of = field_map([0.2, 0.4], [0.0, 0.0], field=PH)  # pH 5 and 6
    assert zone_map(of, costs).zone[:, 0].tolist() == [TREAT, HEALTHY]
    with pytest.raises(MapError, match=r"--low-below 0.4: ph lies in 4..9; give a number in this range"):
        costs_of(FieldSet((PH,)), {"below": ["0.4"]})
    with pytest.raises(
        MapError, match=r"--low-below soil=-1: soil lies in 0..1; give a number in this range"
    ):
        costs_of(PAPER_FIELDS, {"below": ["soil=-1"]})
    (told,) = report_of_maps(get_farm("miniberry-10"), (field_map([0.5], [0.01], field=PH),)).fields
    assert told.expected == 6.5 and 6.4 < told.low < 6.5 < told.high < 6.6
    assert brief(told).startswith("6.5 pH (6.4")
