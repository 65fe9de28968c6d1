"""Version of the installed package, and its behaviour numbers."""

from importlib.metadata import version

__version__ = version("wbf-mission")

BEHAVIOUR = {"environment": 1, "planners": 1, "policies": 1, "flight": 1, "estimators": 1, "scores": 1}
"""Behaviour number of each part of a run; raise it when a change alters results for the same seed.

Benchmark rows are stored and compared by these numbers, so rows stay valid if a change alters no result.
``tools/write_golden_rows.py`` finds out whether results changed.
"""


def behaviour() -> str:
    """Return the behaviour numbers joined by dots, in the order of `BEHAVIOUR`.

    >>> behaviour().count(".") == len(BEHAVIOUR) - 1
    True
    """
    return ".".join(map(str, BEHAVIOUR.values()))
