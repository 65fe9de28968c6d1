"""ArduPilot's packed parameter file, ``@PARAM/param.pck``.

Format: ArduPilot's ``AP_Filesystem_Param.cpp``, which describes it at its head.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from urllib.parse import parse_qsl

from sim_vehicle.autopilot.mav_parameter import MavParameter

__all__ = ["asked_for", "packed", "unpacked"]

_MAGIC, _MAGIC_WITH_DEFAULTS = 0x671B, 0x671C
_HEADER = struct.Struct("<HHH")
_INTEGERS = {8: (1, "<b"), 16: (2, "<h"), 32: (3, "<i")}
_FLOAT = (4, "<f")
_CODES = dict((*_INTEGERS.values(), _FLOAT))
_LONGEST_NAME = 16
_MOST = 65534


def asked_for(query: str) -> tuple[int, int, bool] | None:
    """Read what follows the ``?``: first parameter, how many (0 for all), with defaults; None if wrong.

    Examples
    --------
    >>> asked_for("start=10&count=5&withdefaults=1")
    (10, 5, True)
    """
    start, count, defaults = 0, 0, False
    for key, text in parse_qsl(query, keep_blank_values=True):
        if not (text.isascii() and text.isdigit() and len(text) <= 5 and int(text) <= _MOST):
            return None
        if key == "start":
            start = int(text)
        elif key == "count":
            count = int(text)
        elif key == "withdefaults" and int(text) <= 1:
            defaults = text == "1"
        else:
            return None
    return start, count, defaults


def packed(
    table: Sequence[MavParameter],
    value: Callable[[str], float],
    default: Callable[[str], float],
    query: str = "",
    read_size: int = 0,
) -> bytes | None:
    """Pack parameters.

    Parameters
    ----------
    table : sequence of MavParameter
    value, default : callable
        Given a name, its value now, and at the start.
    query : str
        See `asked_for`.
    read_size : int
        Bytes of the client's reads: values are padded so that none crosses from one read to the next.

    Returns
    -------
    bytes or None
        None if the query is wrong.
    """
    asked = asked_for(query)
    if asked is None or asked[0] >= len(table):
        return None
    start, count, defaults = asked
    chosen = table[start : start + count] if count else table[start:]
    out = bytearray(_HEADER.pack(_MAGIC_WITH_DEFAULTS if defaults else _MAGIC, len(chosen), len(table)))
    before = ""
    for parameter in chosen:
        kind, code = _INTEGERS[parameter.bits] if parameter.integer else _FLOAT
        now = _bytes(parameter, code, value(parameter.name))
        first = _bytes(parameter, code, default(parameter.name))
        differs = defaults and first != now
        common = _common(before, parameter.name)
        rest = parameter.name[common:]
        entry = bytes([kind | differs << 4, common | len(rest) - 1 << 4]) + rest.encode("ascii") + now
        entry += first if differs else b""
        beyond = (len(out) + len(entry)) % read_size if read_size else 0
        if len(now) > 1 and 0 < beyond < len(now):
            out += bytes(len(now) - beyond)
        out += entry
        before = parameter.name
    return bytes(out)


def unpacked(data: bytes) -> list[tuple[str, float]] | None:
    """Read an upload: names and values in their order; None where it is damaged.

    Its header has the length of the file in the place of the number of all parameters.

    Examples
    --------
    >>> unpacked(bytes.fromhex("1b67 0100 0c00 01 20 414243 07"))
    [('ABC', 7.0)]
    """
    if len(data) < _HEADER.size:
        return None
    magic, number, length = _HEADER.unpack_from(data)
    if magic != _MAGIC or length != len(data):
        return None
    found: list[tuple[str, float]] = []
    at, before = _HEADER.size, b""
    for _ in range(number):
        if at + 2 > length or data[at] not in _CODES:
            return None
        code = _CODES[data[at]]
        common, rest = data[at + 1] & 15, (data[at + 1] >> 4) + 1
        value_at = at + 2 + rest
        name = before[:common] + data[at + 2 : value_at]
        at = value_at + struct.calcsize(code)
        if common > len(before) or common + rest > _LONGEST_NAME or at > length or not name.isascii():
            return None
        (value,) = struct.unpack_from(code, data, value_at)
        found.append((name.decode("ascii"), float(value)))
        before = name
    return found


def _common(one: str, other: str) -> int:
    """Count the characters that two names have in common at their beginning."""
    return next((i for i, pair in enumerate(zip(one, other, strict=False)) if pair[0] != pair[1]), len(one))


def _bytes(parameter: MavParameter, code: str, value: float) -> bytes:
    """Return a value as its type holds it."""
    if not parameter.integer:
        return struct.pack(code, value)
    limit = 1 << parameter.bits - 1
    return struct.pack(code, min(max(round(value), -limit), limit - 1))
