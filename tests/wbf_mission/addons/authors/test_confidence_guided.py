import numpy as np
import pytest
import shapely
from policy_observations import observation, report

from geo.farms import get_farm
from mission.errors import PlanningError
from mission.policies.decision import NO_CHANGE
from mission.policies.observation import Event, Status
from sensors.scoring.information import InformationModel
from wbf_mission.addons.authors.confidence_guided import ConfidenceGuided

FARM = get_farm("miniberry-30")
CELL = FARM.cell_size_m
HERE = (15.5 * CELL, 15.5 * CELL)


def _believed(least_certain, field=0, level=0.3):
    """A model as uncertain as `level` everywhere, and more so in one cell, of one field."""
    uncertainty = np.full((3, 30, 30), level, np.float32)
    uncertainty[field, least_certain[0], least_certain[1]] = level + 0.2
    return InformationModel(np.ones_like(uncertainty), uncertainty)


def _flying(system_id=1, rest=((20.0, 20.0),), **known):
    rest = np.array(rest) * CELL
    return report(system_id, status=Status.FLYING, here=HERE, spent=50.0, rest=rest, **known)


def _next(policy, *vehicles, model):
    decision = policy.decide(observation(*vehicles, event=Event.WAYPOINT, model=model))
    return {k: tuple(np.floor(points[0] / CELL).astype(int).tolist()) for k, points in decision.paths.items()}


@pytest.mark.parametrize("cell", [(20, 15), (10, 10), (18, 20), (11, 19)])
def test_the_next_waypoint_is_the_least_certain_cell_of_the_square(cell):
    assert _next(ConfidenceGuided(), _flying(), model=_believed(cell)) == {1: cell}


def test_nothing_is_changed_when_everything_is_certain():
    certain = InformationModel.uniform((30, 30), value=(1, 1, 1), uncertainty=0.0)
    assert ConfidenceGuided().decide(observation(_flying(), event=Event.WAYPOINT, model=certain)) is NO_CHANGE


def test_one_field_counts_or_all_by_their_weights():
    ccr = _believed((12, 12), field=1)
    assert _next(ConfidenceGuided(field="ccr"), _flying(), model=ccr) == {1: (12, 12)}
    assert _next(ConfidenceGuided(field="all"), _flying(), model=ccr) == {1: (12, 12)}
    with pytest.raises(PlanningError, match="unknown field 'rust': choose tylcv, ccr, soil, all"):
        ConfidenceGuided(field="rust").decide(observation(_flying(), model=ccr))


def test_a_chosen_waypoint_is_flown_to_whatever_is_learned_meanwhile():
    policy = ConfidenceGuided()
    first = policy.decide(observation(_flying(), model=_believed((20, 15)))).paths[1]
    on_its_way = _flying(rest=first / CELL)
    other = observation(on_its_way, event=Event.WAYPOINT, model=_believed((10, 10)))
    assert policy.decide(other) is NO_CHANGE
    there = _flying(rest=first[1:] / CELL)
    assert _next(policy, there, model=_believed((10, 10))) == {1: (10, 10)}


def test_a_path_that_is_about_to_end_goes_on_behind_its_waypoint():
    policy = ConfidenceGuided()
    first = policy.decide(observation(_flying(), model=_believed((20, 15)))).paths[1]
    last = _flying(rest=first[:1] / CELL)
    path = policy.decide(observation(last, event=Event.ENDING, model=_believed((10, 10)))).paths[1]
    assert len(path) > 5 and np.allclose(path[0], first[0])


def test_equally_uncertain_cells_are_drawn_by_seed_and_vehicle():
    same = InformationModel.uniform((30, 30), value=(1, 1, 1), uncertainty=0.5)

    def drawn(**known):
        return [_next(ConfidenceGuided(), _flying(k, **known), model=same)[k] for k in (1, 2)]

    found = {tuple(drawn(seed=seed)) for seed in range(20)}
    assert len(found) > 15 and any(one != other for one, other in found)
    policy = ConfidenceGuided()
    first = _next(policy, _flying(), model=same)
    policy.start()
    assert _next(policy, _flying(), model=same) == first


def test_legs_lead_around_nothing_that_must_not_be_crossed():
    pond = shapely.box(16.5 * CELL, 0, 17.5 * CELL, 29 * CELL)
    vehicle = _flying(area=FARM.owner_area - pond)
    decision = ConfidenceGuided().decide(observation(vehicle, model=_believed((19, 15))))
    path = shapely.LineString(np.vstack((HERE, decision.paths[1])))
    assert not path.intersects(pond)


def test_parameters_out_of_range_are_refused():
    with pytest.raises(PlanningError, match="span must be a whole number from 1 to 1000, not 0"):
        ConfidenceGuided(span=0)
