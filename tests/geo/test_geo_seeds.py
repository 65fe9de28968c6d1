import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo.errors import WbfMissionError
from geo.seeds import SeedError, child_seed, root_seed, sealed_seed, stream

NAMES = st.lists(st.text(max_size=8), min_size=1, max_size=4)


def test_streams_are_the_same_on_every_machine():
    assert stream(7, "environment", "tylcv").integers(0, 2**32, 3).tolist() == [
        968630797,
        2098619042,
        2109885701,
    ]


@given(NAMES, NAMES)
def test_different_paths_are_different_streams(first, second):
    same = (child_seed(3, *first).generate_state(4) == child_seed(3, *second).generate_state(4)).all()
    assert bool(same) == (first == second)


def test_streams_neither_advance_the_seed_nor_collide_with_spawned_ones():
    seed = np.random.SeedSequence(11)
    before = stream(seed, "wind").random(4)
    stream(seed, "soil").random(1000)
    assert seed.n_children_spawned == 0
    assert (stream(seed, "wind").random(4) == before).all()
    spawned = {tuple(s.generate_state(2)) for s in seed.spawn(200)}
    assert tuple(child_seed(seed, "wind").generate_state(2)) not in spawned


@pytest.mark.parametrize("bad", [-1, 1.5, "7", None])
def test_bad_seeds_are_refused_in_one_line(bad):
    with pytest.raises(SeedError, match="non-negative integer") as caught:
        stream(bad, "wind")
    assert isinstance(caught.value, WbfMissionError)
    assert "\n" not in str(caught.value)


@given(st.integers(0, 2**128), st.lists(st.text(max_size=5), max_size=3))
def test_a_sealed_seed_tells_nothing_of_the_seed_it_comes_from(seed, names):
    sealed = sealed_seed(seed, *names)
    child = child_seed(seed, *names)
    assert sealed.spawn_key == ()
    assert sealed.entropy != seed
    assert 0 <= sealed.entropy < 2**256
    assert sealed.entropy == sealed_seed(child).entropy
    nested = root_seed(seed)
    for name in names:
        nested = child_seed(nested, name)
    assert (nested.generate_state(4) == child.generate_state(4)).all()
    assert sealed.entropy != sealed_seed(seed, *names, "x").entropy
    assert (sealed.generate_state(4) != child.generate_state(4)).any()


def test_a_sealed_seed_stays_the_same():
    assert stream(sealed_seed(7, "planner")).integers(10**6) == 78187
