"""Random paths of simulated flights."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.estimators.paths import random_path


@given(st.integers(1, 25), st.integers(1, 25), st.integers(0, 2**32), st.integers(1, 300))
@settings(deadline=None, max_examples=60)
def test_ways_of_the_training_stay_on_the_field(width, height, seed, longest):
    cells = random_path((width, height), longest, np.random.default_rng(seed))
    assert 1 <= len(cells) <= longest
    assert (cells >= 0).all()
    assert (cells < [width, height]).all()
