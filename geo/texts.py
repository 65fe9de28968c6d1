"""Functions that escape text, parse numbers and format times and lengths; also the length of a foot."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable
from typing import TypeVar

FOOT_M = 0.3048
"""Metres in one international foot (exact); a cell of the Waterberry Farms benchmark is one square foot."""
MAX_SHOWN = 500  # This many characters fill about five lines of a terminal.
# Windows opens a device when a file has one of these names with any suffix:
# https://learn.microsoft.com/windows/win32/fileio/naming-a-file
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in "0123456789¹²³")}

_Number = TypeVar("_Number", int, float)


def unknown(kind: str, name: str, known: Iterable[str], more: str = "") -> str:
    """Return the message for a name that does not exist: the nearest known name, and all of them.

    >>> unknown("planner", "sprial", ["lawnmower", "spiral"])
    "unknown planner 'sprial' (is 'spiral' meant?): choose lawnmower, spiral"
    """
    names = {each.lower(): each for each in known}
    near = difflib.get_close_matches(name.lower(), names, 1, cutoff=0.7)
    meant = f" (is {names[near[0]]!r} meant?)" if near else ""
    choice = f"choose {', '.join(names.values())}{more}" if names else f"there is none{more}"
    return f"unknown {kind} {name[:60]!r}{meant}: {choice}"


def is_number(value: object) -> bool:
    """Return whether a value is a finite number, and not a whole number that is too large for a float."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def printable(text: str) -> str:
    r"""Return a text with control characters and undecodable bytes escaped; newlines are kept.

    >>> printable("a\x1b[31mred\x07 farm")
    'a\\x1b[31mred\\x07 farm'
    """
    if text.isprintable():
        return text
    return "".join(
        char if char.isprintable() or char == "\n" else char.encode("unicode_escape").decode()
        for char in text
    )


def one_line(text: str, max_characters: int = MAX_SHOWN) -> str:
    r"""Return a text as one printable line of at most `max_characters`.

    >>> one_line("a\x00b.plan:\n  damaged")
    'a\\x00b.plan: damaged'
    """
    line = " ".join(printable(text[: 4 * max_characters]).split())
    return line if len(line) <= max_characters else line[: max_characters - 3] + "..."


def file_stem(text: str, default: str, kept: str = r"\w") -> str:
    """Turn a text into a file name without suffix that Linux, macOS and Windows accept.

    ``kept`` lists the characters that are kept, as in the brackets of a regular expression. If the text has
    none of these characters, the name is ``default``.

    >>> file_stem("../[bold]x[/nope]", "farm"), file_stem("Con", "farm"), file_stem("?", "farm")
    ('bold-x-nope', '_Con', 'farm')
    """
    name = re.sub(f"[^{kept}]+", "-", text).strip("-. ")[:100].rstrip("-. ") or default
    return f"_{name}" if name.partition(".")[0].strip().lower() in _DEVICES else name


def parse_number(text: str) -> float:
    """Return a text as a number, which may be infinity or NaN; raise ValueError if the text is not a number.

    Unlike ``float``, this refuses grouped digits (``1_000``) and digits of other scripts. No ground station
    or autopilot reads such digits, so they are typing errors.

    >>> parse_number(" 2.5e3 ")
    2500.0
    >>> parse_number("1_0")
    Traceback (most recent call last):
        ...
    ValueError: '1_0' is not a number
    """
    return _parsed(text, float, "a number")


def decimal_point(text: str) -> str:
    """Replace the decimal comma of a number by a point; return any other text unchanged.

    >>> decimal_point("-33,508"), decimal_point("1,5,2")
    ('-33.508', '1,5,2')
    """
    whole, comma, decimals = text.partition(",")
    digits = whole.removeprefix("-") + decimals
    return f"{whole}.{decimals}" if comma and decimals and digits.isdecimal() else text


def parse_whole(text: str) -> int:
    """Return a text as a whole number; raise ValueError as `parse_number` does.

    >>> parse_whole("-12")
    -12
    """
    return _parsed(text, int, "a whole number")


def _parsed(text: str, kind: Callable[[str], _Number], what: str) -> _Number:
    try:
        if not text.isascii() or "_" in text:
            raise ValueError
        return kind(text)
    except ValueError:
        raise ValueError(f"{text[:40]!r} is not {what}") from None


def duration(seconds: float) -> str:
    """Return a duration in seconds as readable text.

    >>> duration(75.4)
    '1 min 15 s'
    >>> duration(3.21)
    '3.2 s'
    """
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def distance(metres: float) -> str:
    """Return a distance in metres as readable text.

    >>> distance(12345)
    '12.35 km'
    """
    return f"{metres / 1000:.2f} km" if metres >= 10_000 else f"{metres:.1f} m"
