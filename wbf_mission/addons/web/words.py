"""Messages of the program that name the page's inputs instead of command line options."""

from __future__ import annotations

import re
from functools import lru_cache

from geo.texts import one_line
from wbf_mission.scenario.scenario import all_options

_FLAG = re.compile(r"(?<![\w-])--[a-z][a-z0-9]*(-[a-z0-9]+)*")
_ONLY_THERE = re.compile(r",? --force does it nevertheless")
"""Advice that has no input on the page."""
_OTHERS = {
    "--crop": "Crop",
    "--farm-crs": "Coordinate system",
    "--repair": "Mend it",
    "--wind": "Wind speed",
    "--wind-shear": "Wind shear",
}
"""Inputs of the page that are not draft options, or that stand for several options."""


def worded(text: object) -> str:
    """Return a text on one line, with the page's input names in place of options.

    >>> worded("the polygon is not valid; --repair mends what is safe to mend")
    "the polygon is not valid; 'Mend it' mends what is safe to mend"
    >>> worded("give --budget, such as 8000m"), worded("fly slower, or a smaller --no-such-option")
    ("give 'Budget', such as 8000m", "fly slower, or a smaller 'No such option'")
    """
    return _FLAG.sub(_name, _ONLY_THERE.sub("", one_line(str(text))))


def _name(flag: re.Match[str]) -> str:
    text = flag[0]
    return f"'{_labels().get(text) or _capital(text[2:].replace('-', ' '))}'"


@lru_cache(maxsize=1)
def _labels() -> dict[str, str]:
    known = {str(option.flag): _capital(option.label) for _, _, option in all_options().values()}
    return known | _OTHERS


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
