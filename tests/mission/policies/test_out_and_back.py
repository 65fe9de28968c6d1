"""Beyond the radio's range: paths end where the next one can be told."""

from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from policy_observations import observation, report

from geo import get_farm
from mission.planners import StepBudget
from mission.planners.path import path_length
from mission.policies.map_policies import Greedy, Orienteering, RollingHorizon
from mission.policies.observation import ContactArea

FARM = get_farm("miniberry-30")
POLICIES = pytest.mark.parametrize("policy", [Greedy, Orienteering, RollingHorizon])
HOME_M = FARM.home_m


def answer(policy, contact, *, steps=600.0, area=FARM.owner_area, position_m=HOME_M):
    """Ask for the first path of a robot on a farm of which nothing is known."""
    made = policy()
    made.start()
    robot = report(steps=steps, area=area, here=position_m, contact=contact)
    return made.decide(observation(robot)).paths[1]


@cache
def unlimited(policy):
    """Return the first path of a robot that can be told a path anywhere."""
    return answer(policy, None)


@POLICIES
@pytest.mark.parametrize("radius_m", [0.0, 2.0, 4.0])
def test_a_path_leads_back_to_where_the_next_can_be_told(policy, radius_m):
    contact = ContactArea(HOME_M, radius_m)
    without, path = unlimited(policy), answer(policy, contact)
    assert contact.away_m(without[-1]) > 0.0
    # The way there is what it would fly anyway; a circle without a cell in it is its nearest cell.
    assert np.array_equal(path[: len(without)], without)
    assert contact.away_m(path[-1]) <= FARM.cell_size_m
    # It is worth the way back.
    assert path_length(path) > 2.0 * path_length(path[-2:])


@POLICIES
def test_where_nothing_can_be_told_the_first_path_uses_the_budget(policy):
    path = answer(policy, ContactArea(HOME_M, -1.0))
    assert 590.0 < StepBudget(600.0).cost(np.vstack((HOME_M, path))) <= 600.0


def test_what_the_budget_does_not_pay_for_is_cut_off():
    contact = ContactArea(HOME_M, 1.0)
    path = answer(RollingHorizon, contact, steps=45.0)
    assert contact.away_m(path[-1]) > 0.0
    assert StepBudget(45.0).cost(np.vstack((HOME_M, path))) <= 45.0


@settings(max_examples=25, deadline=None)
@given(x=st.floats(-5.0, 14.0), y=st.floats(-5.0, 14.0), radius_m=st.floats(-1.0, 6.0))
def test_wherever_the_station_is_every_leg_stays_on_the_land(x, y, radius_m):
    side = FARM.width_cells * FARM.cell_size_m
    # Two arms: from one to the other the way leads round the corner.
    land = shapely.box(0.0, 0.0, side, side).difference(shapely.box(3.0, 3.0, side, side))
    path = answer(Greedy, ContactArea((x, y), radius_m), area=land, position_m=(0.5, 0.5), steps=300.0)
    way = shapely.LineString(np.vstack(((0.5, 0.5), path)))
    assert shapely.covers(shapely.buffer(land, 1e-6), way)
    assert StepBudget(300.0).cost(np.asarray(way.coords)) <= 300.0
