"""Named random streams: one seed per run, one independent stream per purpose.

A run has one `numpy.random.SeedSequence`. Each consumer of randomness takes the stream of its own name, so
that a further consumer, or a further draw in one of them, never changes the numbers of another::

    child_seed(7, "environment")                  the environment's seed
    stream(7, "environment", "tylcv")             a generator for one of its parts
    stream(child_seed(7, "environment"), "tylcv") the same generator

From name to stream: the first eight bytes of the SHA-256 of the name in UTF-8, read as two little-endian
32-bit words, are appended to the spawn key of the seed. Each name adds exactly two words, so no two paths of
names have one key, and the words do not collide with the small counters of ``SeedSequence.spawn``. Nothing
depends on the machine, on ``PYTHONHASHSEED`` or on the order of calls.

A child seed carries the run's seed (``entropy``), which opens every other stream of the run. Code that must
not know the truth, a planner or an estimator, gets a `sealed_seed`.
"""

from __future__ import annotations

import hashlib
import operator

import numpy as np
from numpy.random import PCG64, Generator, SeedSequence

from geo.errors import WbfMissionError

_SEALED_WORDS = 8  # 512 bits, more than a seed has
_HINT = "give a non-negative integer or a numpy.random.SeedSequence"


class SeedError(WbfMissionError, ValueError):
    """A seed that is not a non-negative integer or a ``SeedSequence``."""


def root_seed(seed: SeedSequence | int) -> SeedSequence:
    """Return the seed sequence of a seed; SeedError if it is negative or not an integer."""
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
    """Derive the seed of a named part from the seed and the names alone; SeedError as of `root_seed`.

    The seed is that of the run or of an enclosing part; its spawn counter stays. The names are the path to
    the part, for example ``"vehicle-1", "wind"``; no names give the seed itself.

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
    """Open the random stream of a named part at its beginning; seed and names are those of `child_seed`.

    The bit generator is PCG64, whatever numpy's default becomes.

    >>> float(stream(7, "wind").random()) == float(stream(7, "wind").random())
    True
    >>> float(stream(7, "wind").random()) == float(stream(7, "soil").random())
    False
    """
    return Generator(PCG64(child_seed(seed, *names)))


def sealed_seed(seed: SeedSequence | int, *names: str) -> SeedSequence:
    """Derive a seed for code that must not learn the run's seed; seed and names are those of `child_seed`.

    Its entropy is the SHA-256 of the child seed's state, read as a little-endian integer, and its spawn key
    is empty, so neither the run's seed nor another stream can be computed from it. A run's seed that is
    easily guessed (0, 1, 2, ...) can still be found by trying: take 128 random bits where that matters.

    >>> sealed = sealed_seed(7, "planner")
    >>> sealed.entropy == sealed_seed(7, "planner").entropy, sealed.entropy == 7
    (True, False)
    """
    state = child_seed(seed, *names).generate_state(_SEALED_WORDS, np.uint64)
    digest = hashlib.sha256(state.astype("<u8").tobytes()).digest()
    return SeedSequence(int.from_bytes(digest, "little"))
