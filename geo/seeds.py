"""Named random streams: one seed per run, one independent stream per purpose.

A run has one `numpy.random.SeedSequence`. Each consumer of randomness has a named stream of its own, so that
additional consumers, or additional draws from a stream, do not change the numbers of other streams::

    child_seed(7, "environment")                  the environment's seed
    stream(7, "environment", "tylcv")             a generator for one of its parts
    stream(child_seed(7, "environment"), "tylcv") the same generator

A name appends two little-endian 32-bit words to the spawn key of the seed: the first eight bytes of the
SHA-256 of the name in UTF-8. As each name adds exactly two words, different paths of names have different
keys, and the words do not collide with the small counters of ``SeedSequence.spawn``. The streams do not
depend on the machine, ``PYTHONHASHSEED`` or the order of calls.

A child seed contains the run's seed (``entropy``), which opens all streams of the run. Planners and
estimators must not know the truth, so they get a `sealed_seed`.
"""

from __future__ import annotations

import hashlib
import operator

import numpy as np
from numpy.random import PCG64, Generator, SeedSequence

from geo.errors import WbfMissionError

_SEALED_WORDS = 8  # 512 bits, more than the entropy of a seed
_HINT = "give a non-negative integer or a numpy.random.SeedSequence"


class SeedError(WbfMissionError, ValueError):
    """A seed that is not a non-negative integer or a ``SeedSequence``."""


def root_seed(seed: SeedSequence | int) -> SeedSequence:
    """Return the seed sequence of a seed; SeedError if the seed is negative or not an integer."""
    if isinstance(seed, SeedSequence):
        return seed
    try:
        number = operator.index(seed)
    except TypeError:
        raise SeedError(f"seed {seed!r} is no seed: {_HINT}") from None
    if number < 0:
        raise SeedError(f"seed {number} is negative: {_HINT}")
    return SeedSequence(number)


def child_seed(seed: SeedSequence | int, *names: str) -> SeedSequence:
    """Derive the seed of a named part from `seed` and `names` alone; SeedError as in `root_seed`.

    `seed` belongs to the run or to an enclosing part; its spawn counter does not change. `names` is the path
    to the part, for example ``"vehicle-1", "wind"``; without names the result is `seed` itself.

    >>> a = child_seed(7, "environment", "soil")
    >>> b = child_seed(child_seed(7, "environment"), "soil")
    >>> bool((a.generate_state(4) == b.generate_state(4)).all())
    True
    """
    root = root_seed(seed)
    if not names:
        return root
    words: list[int] = []
    for name in names:
        digest = hashlib.sha256(name.encode("utf-8")).digest()
        words += [int.from_bytes(digest[0:4], "little"), int.from_bytes(digest[4:8], "little")]
    return SeedSequence(entropy=root.entropy, spawn_key=(*root.spawn_key, *words), pool_size=root.pool_size)


def stream(seed: SeedSequence | int, *names: str) -> Generator:
    """Return a new generator at the beginning of a named part's stream; parameters as in `child_seed`.

    The bit generator is PCG64, even if numpy's default changes.

    >>> float(stream(7, "wind").random()) == float(stream(7, "wind").random())
    True
    >>> float(stream(7, "wind").random()) == float(stream(7, "soil").random())
    False
    """
    return Generator(PCG64(child_seed(seed, *names)))


def sealed_seed(seed: SeedSequence | int, *names: str) -> SeedSequence:
    """Derive a seed for code that must not know the run's seed; parameters as in `child_seed`.

    The entropy of the result is the SHA-256 of the child seed's state, read as a little-endian integer, and
    the spawn key is empty. The run's seed and other streams thus cannot be computed from the result. A small
    seed (0, 1, 2, ...) can still be found by trial: use 128 random bits where that matters.

    >>> sealed = sealed_seed(7, "planner")
    >>> sealed.entropy == sealed_seed(7, "planner").entropy, sealed.entropy == 7
    (True, False)
    """
    state = child_seed(seed, *names).generate_state(_SEALED_WORDS, np.uint64)
    digest = hashlib.sha256(state.astype("<u8").tobytes()).digest()
    return SeedSequence(int.from_bytes(digest, "little"))
