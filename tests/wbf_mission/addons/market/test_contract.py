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
