import numpy as np
import shapely

from wbf_mission.addons.market.market import Contract, Stretch
from wbf_mission.addons.market.segments import Segment, rows_over

FIELD = shapely.box(0, 0, 10, 10)


def _contract():
    """Two rows of a segment to and fro, and a leg to nowhere."""
    segment = Segment(3, False, (0, 0, 10, 4), rows_over((0, 0, 10, 4), FIELD, 2.0))
    stretches = tuple(Stretch(segment, k, ends) for k, ends in segment.ordered(0))
    stretches += (Stretch(None, 0, np.array([[5.0, 8.0]])),)
    return Contract(stretches, np.concatenate([one.points_m for one in stretches])), segment


def test_nothing_flown_leaves_everything():
    contract, segment = _contract()
    assert contract.follow(contract.points_m) and contract.begun is None
    (left,) = contract.unflown((0.0, 0.0))
    assert left.number == 3 and len(left.rows) == len(segment.rows) == 2
    assert len(contract.work()) == 4


def test_in_a_row_what_is_ahead_of_the_vehicle_is_left():
    contract, segment = _contract()
    assert contract.follow(contract.points_m[3:]) and contract.begun is segment
    (left,) = contract.unflown((4.0, 3.1))
    assert len(left.rows) == 1 and left.rows[0].ends_m.tolist() == [[0.0, 3.0], [4.0, 3.0]]


def test_at_the_end_of_a_row_nothing_of_it_is_left():
    contract, segment = _contract()
    assert contract.follow(contract.points_m[1:])
    (left,) = contract.unflown((10.0, 1.0))
    assert [row.line for row in left.rows] == [segment.rows[1].line]
    assert contract.follow(contract.points_m[3:])
    assert contract.unflown((0.0, 3.0)) == []


def test_a_flown_segment_leaves_nothing():
    contract, _ = _contract()
    assert contract.follow(contract.points_m[4:]) and contract.begun is None
    assert contract.unflown((10.0, 3.0)) == [] and not len(contract.work())


def test_a_vehicle_that_flies_something_else_is_noticed():
    contract, _ = _contract()
    assert not contract.follow(contract.points_m[2:] + 1.0)
    assert contract.follow(contract.points_m[2:] + 0.01)


def test_a_path_that_was_cut_has_less_ahead():
    contract, segment = _contract()
    cut = Contract(contract.stretches, contract.points_m[:3])
    assert len(cut.work()) == 3 and {one.segment for one, _ in cut.ahead} == {segment}
