"""Named random streams: one seed per run, one independent stream per purpose.

A run has one `numpy.random.SeedSequence`. Each consumer of random numbers draws from its own named stream. A
further consumer, or further draws from a stream, then leave the numbers of other streams unchanged::

    child_seed(7, "environment")                  the environment's seed
    stream(7, "environment", "tylcv")             a generator for one of its parts
    stream(child_seed(7, "environment"), "tylcv") the same generator

A name appends two little-endian 32-bit words to the spawn key of the seed, namely the first eight bytes of
the SHA-256 of the name in UTF-8. Since each name adds exactly two words, different paths of names have
different keys. Such words do not collide with the small counters of ``SeedSequence.spawn``. The streams do
not depend on the machine, ``PYTHONHASHSEED`` or the order of calls.

A child seed contains the run's seed (``entropy``), from which every stream of the run can be computed.
Planners and estimators must not know the true field, so they get a `sealed_seed`.
"""

from __future__ import annotations

import hashlib
import operator

import numpy as np
from numpy.random import PCG64, Generator, SeedSequence

from geo.errors import WbfMissionError

_SEALED_WORDS = 8  # 64-bit words; 512 bits are more than the entropy of a seed
_HINT = "give a non-negative integer or a numpy.random.SeedSequence"


class SeedError(WbfMissionError, ValueError):
    """Error of a seed that is neither a non-negative integer nor a ``SeedSequence``."""


def root_seed(seed: SeedSequence | int) -> SeedSequence:
    """Return the seed sequence of a seed; raise SeedError if the seed is negative or not an integer."""
    if isinstance(seed, SeedSequence):
        return seed
    try:
        number = operator.index(seed)
    except TypeError:
        raise SeedError(f"seed {seed!r} is not a seed: {_HINT}") from None
    if number < 0:
        raise SeedError(f"seed {number} is negative: {_HINT}")
    return SeedSequence(number)


def child_seed(seed: SeedSequence | int, *names: str) -> SeedSequence:
    """Derive the seed of a named part from `seed` and `names` alone; raise SeedError as `root_seed` does.

    `seed` belongs to the run or to an enclosing part; the seed's spawn counter does not change. `names` is
    the path to the part, for example ``"vehicle-1", "wind"``. Without names, the result is `seed` itself.

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
    """Return a new generator at the start of a named part's stream; parameters as in `child_seed`.

    The bit generator stays PCG64 even if numpy's default changes.

    >>> float(stream(7, "wind").random()) == float(stream(7, "wind").random())
    True
    >>> float(stream(7, "wind").random()) == float(stream(7, "soil").random())
    False
    """
    return Generator(PCG64(child_seed(seed, *names)))


def sealed_seed(seed: SeedSequence | int, *names: str) -> SeedSequence:
    """Derive a seed for code that must not know the run's seed; parameters as in `child_seed`.

    The result's entropy is the SHA-256 of the child seed's state, read as a little-endian integer, and its
    spawn key is empty. The run's seed and its other streams thus cannot be computed from the result. A small
    seed (0, 1, 2, ...) can still be found by trial; if that matters, use a seed of 128 random bits.

    >>> sealed = sealed_seed(7, "planner")
    >>> sealed.entropy == sealed_seed(7, "planner").entropy, sealed.entropy == 7
    (True, False)
    """
    state = child_seed(seed, *names).generate_state(_SEALED_WORDS, np.uint64)
    digest = hashlib.sha256(state.astype("<u8").tobytes()).digest()
    return SeedSequence(int.from_bytes(digest, "little"))
