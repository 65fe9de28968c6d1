from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo.errors import WbfMissionError
from geo.seeds import SeedError, child_seed, root_seed, sealed_seed, stream

NAMES = st.lists(st.text(max_size=8), min_size=1, max_size=4)


def test_streams_are_the_same_on_every_machine() -> None:
    assert stream(7, "environment", "tylcv").integers(0, 2**32, 3).tolist() == [
        968630797,
        2098619042,
        2109885701,
    ]


@given(st.integers(0, 2**128), NAMES)
def test_a_path_of_names_equals_nested_children(seed: int, names: list[str]) -> None:
    nested = root_seed(seed)
    for name in names:
        nested = child_seed(nested, name)
    assert (nested.generate_state(4) == child_seed(seed, *names).generate_state(4)).all()


@given(NAMES, NAMES)
def test_different_paths_are_different_streams(first: list[str], second: list[str]) -> None:
    same = (child_seed(3, *first).generate_state(4) == child_seed(3, *second).generate_state(4)).all()
    assert bool(same) == (first == second)


def test_taking_a_stream_does_not_advance_the_seed() -> None:
    seed = np.random.SeedSequence(11)
    before = stream(seed, "wind").random(4)
    stream(seed, "soil").random(1000)
    assert seed.n_children_spawned == 0
    assert (stream(seed, "wind").random(4) == before).all()


def test_named_children_do_not_collide_with_spawned_ones() -> None:
    seed = np.random.SeedSequence(11)
    spawned = {tuple(s.generate_state(2)) for s in seed.spawn(200)}
    assert tuple(child_seed(seed, "wind").generate_state(2)) not in spawned


def test_no_name_is_the_seed_itself() -> None:
    seed = np.random.SeedSequence(5)
    assert child_seed(seed) is seed


@pytest.mark.parametrize("bad", [-1, 1.5, "7", None])
def test_bad_seeds_are_refused_in_one_line(bad: object) -> None:
    with pytest.raises(SeedError, match="non-negative integer") as caught:
        stream(bad, "wind")  # type: ignore[arg-type]
    assert isinstance(caught.value, WbfMissionError)
    assert "\n" not in str(caught.value)


def test_numpy_integers_are_seeds() -> None:
    number: Any = np.int64(7)
    assert stream(number, "a").random() == stream(7, "a").random()


@given(st.integers(0, 2**128), st.lists(st.text(max_size=5), max_size=3))
def test_a_sealed_seed_tells_nothing_of_the_seed_it_comes_from(seed: int, names: list[str]) -> None:
    sealed = sealed_seed(seed, *names)
    child = child_seed(seed, *names)
    assert sealed.spawn_key == ()
    assert sealed.entropy != seed
    assert 0 <= sealed.entropy < 2**256
    assert sealed.entropy == sealed_seed(child).entropy
    assert sealed.entropy != sealed_seed(seed, *names, "x").entropy
    assert (sealed.generate_state(4) != child.generate_state(4)).any()


def test_a_sealed_seed_stays_the_same() -> None:
    assert stream(sealed_seed(7, "planner")).integers(10**6) == 78187


def test_a_sealed_seed_refuses_what_is_no_seed() -> None:
    with pytest.raises(SeedError, match="negative"):
        sealed_seed(-1, "planner")
