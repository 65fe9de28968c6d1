"""The version of the installed package, and the numbers of its behaviour."""

from importlib.metadata import version

__version__ = version("wbf-mission")

BEHAVIOUR = {"environment": 1, "planners": 1, "policies": 1, "flight": 1, "estimators": 1, "scores": 1}
"""A number for each room of what flies: raise it when the same seed gives another result there.

Rows of a benchmark are kept, flown again and compared by these numbers, so a change that leaves every result
as it was keeps all rows. ``tools/write_golden_rows.py`` finds out which kind a change is.
"""


def behaviour() -> str:
    """Return the numbers in one word, in the order of the rooms.

    >>> behaviour().count(".") == len(BEHAVIOUR) - 1
    True
    """
    return ".".join(map(str, BEHAVIOUR.values()))
