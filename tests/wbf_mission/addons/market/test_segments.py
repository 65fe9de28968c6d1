from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from wbf_mission.addons.market.segments import VARIANTS, Segment, blocks_of, corners_of, groups_of, rows_over

FIELD = shapely.box(0, 0, 40, 30)


def _segment(box, flyable=FIELD, spacing=2.0):
    return Segment(1, True, box, rows_over(box, flyable, spacing))


@given(st.floats(1, 30), st.floats(1, 30), st.floats(0.2, 12))
def test_rows_leave_no_gap_wider_than_their_spacing(width, height, spacing):
    rows = rows_over((5.0, 5.0, 5.0 + width, 5.0 + height), shapely.box(0, 0, 60, 60), spacing)
    along = int(height > width + 1e-3)
    across = width if along else height
    heights = np.array([row.ends_m[0, 1 - along] for row in rows]) - 5.0
    gaps = np.diff(np.concatenate(([-heights[0]], heights, [2 * across - heights[-1]])))
    assert np.allclose(gaps, gaps[0])
    assert gaps[0] <= 1.5 * spacing + 1e-9


def test_rows_end_where_flying_does():
    pond = shapely.box(10, 4, 14, 8)
    segment = _segment((0, 2, 30, 10), FIELD - pond)
    lines = shapely.multilinestrings([row.ends_m for row in segment.rows])
    assert (FIELD - pond).buffer(1e-9).covers(lines)
    assert sorted(row.line for row in segment.rows) == [0, 1, 1, 2, 2, 3]
    assert rows_over((50, 50, 60, 60), FIELD, 1.0) == ()


@pytest.mark.parametrize("variant", range(VARIANTS))
def test_every_variant_flies_every_row_once_to_and_fro_from_its_corner(variant):
    segment = _segment((0, 0, 20, 8))
    flown = segment.ordered(variant)
    assert sorted(number for number, _ in flown) == [0, 1, 2, 3]
    x, y = flown[0][1][0]
    assert (x == 20.0) == bool(variant & 1) and (y > 4.0) == bool(variant & 2)
    for (_, before), (_, after) in pairwise(flown):
        assert before[1, 0] == after[0, 0]
    corners = corners_of([segment])[0]
    assert corners[variant].tolist() == [x, y]
    assert corners[VARIANTS + variant].tolist() == flown[-1][1][1].tolist()


@pytest.mark.parametrize("count", [1, 4, 9, 12])
def test_blocks_cover_the_bounds_and_do_not_overlap(count):
    boxes = blocks_of(FIELD, count)
    assert abs(len(boxes) - count) <= 0.34 * count
    together = shapely.union_all([shapely.box(*box) for box in boxes])
    assert together.symmetric_difference(FIELD).area < 1e-9
    segments = [_segment(box) for box in boxes]
    assert not any(a.overlaps(b.box_m) for a in segments for b in segments if a is not b)


def test_groups_hang_together():
    cells = np.array([[0, 0], [9, 9], [2, 1], [4, 3], [9, 10]])
    found = sorted(sorted(group.tolist()) for group in groups_of(cells, 3.0))
    assert found == [[0, 2, 3], [1, 4]]
    assert groups_of(cells[:0], 3.0) == [] and [one.tolist() for one in groups_of(cells[:1], 3.0)] == [[0]]
