import itertools
from dataclasses import replace

import numpy as np
import pytest
from policy_observations import observation, report

from geo.farms import get_farm
from geo.grid import Crop
from mission.errors import PlanningError
from mission.planners.request import CropArea
from mission.policies.decision import NO_CHANGE
from mission.policies.observation import Event, Status
from sensors.observations import Observations
from wbf_mission.addons.authors.refining_lawnmower import RefiningLawnmower, detour, window_of

FARM = get_farm("miniberry-30")
CELL = FARM.cell_size_m
CROPS = tuple(CropArea(crop, FARM.crop_area(crop)) for crop in (Crop.STRAWBERRY, Crop.TOMATO))


def _vehicle(system_id=1, x=15.5, y=22.5, rest=((28.5, 22.5),), spent=50.0, **known):
    rest = np.array(rest).reshape(-1, 2) * CELL
    vehicle = report(
        system_id,
        status=Status.FLYING,
        here=(x * CELL, y * CELL),
        spent=spent,
        rest=rest,
        steps=400.0,
        **known,
    )
    return replace(vehicle, request=replace(vehicle.request, crop_areas=CROPS))


def _seen(*cells, values=(0.5, 1.0, 0.4), day=6):
    x, y = np.array(cells).T
    count = len(cells)
    return Observations(
        x, y, np.arange(float(count)), np.full(count, day), np.broadcast_to(values, (count, 3))
    )


def _one_sick(count):
    """Readings of which the first one is sick."""
    return np.vstack(([[0.5, 1.0, 0.4]], np.tile([1.0, 1.0, 0.4], (count - 1, 1))))


def _cells(route):
    return {tuple(cell) for cell in np.floor(np.asarray(route) / CELL).astype(int).tolist()}


def _detour(*cells, vehicle=None, promised=(), least_rate=0.2, **known):
    vehicle = _vehicle() if vehicle is None else vehicle
    told = observation(vehicle, event=Event.OBSERVATIONS, seen=_seen(*cells, **known))
    return detour(vehicle, told, window_of(vehicle, told, promised), least_rate)


def test_a_detour_leads_to_all_plants_beside_a_sick_one():
    route = np.vstack(([[15.5, 22.5]], _detour((15, 22)) / CELL))
    corners = np.concatenate(
        [a + np.linspace(0, 1, 60)[:, None] * (b - a) for a, b in itertools.pairwise(route)]
    )
    flown = {tuple(cell) for cell in np.floor(corners).astype(int).tolist()}
    beside = {(x, y) for x in (14, 15, 16) for y in (21, 22, 23)} - {(15, 22)}
    assert len(beside - flown) <= 1


@pytest.mark.parametrize(
    "known",
    [{"values": (1.0, 1.0, 0.4)}, {"day": 5}, {"values": (1.0, 0.5, 0.4)}, {"values": (np.nan, 1.0, 0.4)}],
    ids=["healthy", "another day", "of the other crop", "not sensed"],
)
def test_there_is_no_detour_without_a_sick_plant_of_today(known):
    assert len(_detour((15, 22), **known)) == 0


def test_there_is_no_detour_where_all_is_known_promised_or_not_worth_while():
    around = [(15, 22), *((x, y) for x in range(12, 19) for y in range(19, 26) if (x, y) != (15, 22))]
    assert len(_detour(*around, values=_one_sick(len(around)))) == 0
    rows = [np.array([[12.5, y], [18.5, y]]) * CELL for y in np.arange(19.5, 26.0)]
    assert len(_detour((15, 22), promised=rows)) == 0
    assert len(_detour((15, 22), least_rate=2.0)) == 0


def test_rows_begin_on_the_land_of_the_weightier_disease_and_keep_their_distance():
    vehicle = replace(_vehicle(rest=(), x=0.0, y=0.0, spent=0.0), status=Status.READY)
    policy = RefiningLawnmower(gap=6.0, later_gap=3.0)
    policy.start()
    rows = policy.decide(observation(vehicle)).paths[1] / CELL
    tomatoes = rows[:, 1] > 15.0
    assert tomatoes[0] and not tomatoes[-1] and np.count_nonzero(np.diff(tomatoes.astype(int))) == 1
    for land, gap in ((tomatoes, 6.0), (~tomatoes, 3.0)):
        distances = np.diff(np.unique(rows[land, 1].round(6)))
        assert (distances >= gap - 1e-6).all() and (distances < 2.0 * gap).all()


def test_rows_are_left_at_a_find_and_taken_up_again_where_they_were_left():
    ready = replace(_vehicle(rest=(), x=0.0, y=0.0, spent=0.0), status=Status.READY)
    policy = RefiningLawnmower()
    policy.start()
    rows = policy.decide(observation(ready)).paths[1] / CELL
    row = rows[2, 1]
    here = (15.5, float(row))
    # On its second row; the first two points are behind it.
    flying = _vehicle(x=here[0], y=here[1], rest=rows[3:])
    healthy = _seen((14, int(row)), (15, int(row)), values=(1.0, 1.0, 0.4))
    assert policy.decide(observation(flying, event=Event.OBSERVATIONS, seen=healthy)) is NO_CHANGE
    sick = _seen((15, int(row)))
    decision = policy.decide(observation(flying, event=Event.OBSERVATIONS, seen=sick))
    away = decision.paths[1] / CELL
    assert decision.acquisition is not None and decision.acquisition.cell_m == pytest.approx(CELL)
    worth = decision.acquisition.values
    x, y = np.nonzero(worth)
    assert worth[15, int(row)] == 0.0 and worth[14, int(row)] == worth.max() == 1.0
    assert np.abs(x - 15).max() <= 3 and np.abs(y - int(row)).max() <= 3
    assert np.allclose(away[-len(rows[3:]) :], rows[3:])
    back = away[-len(rows[3:]) - 1]
    assert back[1] == pytest.approx(row) and len(away) > len(rows[3:]) + 2
    # All around it is known now: it goes back to the row, and then on.
    cells = [(x, y) for x in range(11, 20) for y in range(15, 30) if (x, y) != (15, int(row))]
    known = _seen((15, int(row)), *cells, values=_one_sick(len(cells) + 1))
    detoured = _vehicle(x=16.5, y=here[1] + 2.0, rest=away[-len(rows[3:]) - 2 :])
    again = policy.decide(observation(detoured, event=Event.OBSERVATIONS, seen=known)).paths[1] / CELL
    assert np.allclose(again[1:], rows[3:]) and again[0, 1] == pytest.approx(row)
    assert policy.decide(observation(detoured, event=Event.OBSERVATIONS, seen=known)) is NO_CHANGE


@pytest.mark.parametrize("wrong", [{"coarse": 0.0}, {"coarse": 1.5}, {"gap": 0.0}, {"later_gap": -1.0}])
def test_parameters_out_of_their_range_are_refused(wrong):
    with pytest.raises(PlanningError, match="refining-lawnmower: "):
        RefiningLawnmower(**wrong)
