"""Parses and formats names with parameters, such as ``lawnmower:direction=0.3``.

The name is followed by a colon and by ``key=value`` pairs, separated by commas. A value is

- a number: ``3``, ``0.3``, ``-1e-3``;
- ``true``, ``false`` or ``none``;
- a list of values in brackets, ``[1, 10]``, which becomes a tuple;
- any other text, with double quotes if the text has a comma or bracket or looks like a value above.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping
from typing import TypeAlias

from geo.errors import WbfMissionError
from geo.texts import unknown

Scalar: TypeAlias = bool | int | float | str | None
Parameter: TypeAlias = Scalar | tuple[Scalar, ...]

_CONSTANTS: dict[str, Scalar] = {"true": True, "false": False, "none": None}
_INTEGER = re.compile(r"[+-]?[0-9]{1,18}", re.ASCII)
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", re.ASCII)
_TOKEN = re.compile(r'"[^"]*"|[\[\],]|[^\[\],"]+')
_HINT = "write NAME or NAME:key=value,key=value"


class ParameterError(WbfMissionError, ValueError):
    """Error of parameters that cannot be parsed, or that a planner, policy or estimator does not have."""


def parse_named(text: str) -> tuple[str, dict[str, Parameter]]:
    """Parse a name and its parameters.

    Spaces around names, keys and values are ignored. Raise ParameterError if the name is missing, a pair is
    not ``key=value``, a key is repeated, or a value is not finite.

    Examples
    --------
    >>> parse_named("spiral")
    ('spiral', {})
    >>> parse_named("gp:learn_from=observations,length_bounds=[1,10]")
    ('gp', {'learn_from': 'observations', 'length_bounds': (1, 10)})
    """
    name, colon, rest = text.partition(":")
    name = name.strip()
    if not name or "=" in name:
        raise ParameterError(f"{text!r} begins without a name: {_HINT}")
    parameters: dict[str, Parameter] = {}
    for pair in _split(rest, text) if colon else ():
        key, equals, value = pair.partition("=")
        key = key.strip()
        if not (equals and key.isidentifier()):
            raise ParameterError(f"{text!r}: {pair.strip()!r} is not key=value; {_HINT}")
        if key in parameters:
            raise ParameterError(f"{text!r}: {key} is given twice; give it once")
        parameters[key] = _value(value.strip(), key, text)
    return name, parameters


def format_named(name: str, parameters: Mapping[str, object]) -> str:
    """Return a name and its parameters as one text that `parse_named` reads.

    `parse_named` reads the same values back if they are finite numbers, true, false, none, texts without
    quotation marks, or sequences of such values.

    Examples
    --------
    >>> format_named("gp", {"learn_from": "model", "length_bounds": (1, 10), "file": "a b"})
    'gp:learn_from=model,length_bounds=[1,10],file="a b"'
    >>> format_named("spiral", {})
    'spiral'
    """
    pairs = ",".join(f"{key}={_format(value)}" for key, value in parameters.items())
    return f"{name}:{pairs}" if pairs else name


def split_named(text: str) -> list[str]:
    """Split a comma-separated list of names with parameters; commas between a name's parameters do not split.

    Raise ParameterError if a quotation mark or bracket is not closed.

    Examples
    --------
    >>> split_named("lawnmower:direction=0.3,inset=1,spiral")
    ['lawnmower:direction=0.3,inset=1', 'spiral']
    """
    found: list[str] = []
    for part in (piece.strip() for piece in _split(text, text)):
        # A part key=value that does not begin with a name and a colon belongs to the preceding name.
        if found and "=" in part and ":" not in part.partition("=")[0]:
            found[-1] += f",{part}"
        elif part:
            found.append(part)
    return found


def check_parameters(owner: str, given: Iterable[str], known: Collection[str]) -> None:
    """Raise ParameterError for parameters that `owner`, such as ``planner spiral``, does not have."""
    wrong = sorted(set(given).difference(known))
    if wrong:
        raise ParameterError(f"{owner}: {unknown('parameter', wrong[0], sorted(known))}")


def _split(text: str, whole: str) -> list[str]:
    """Split a text at commas outside brackets and quotation marks."""
    parts, inside, position = [""], False, 0
    unpaired = ParameterError(f"{whole!r}: brackets do not pair; a list is written [1, 10]")
    while position < len(text):
        token = _TOKEN.match(text, position)
        if token is None:
            raise ParameterError(f"{whole!r}: a quotation mark is not closed")
        position = token.end()
        if token[0] in ("[", "]"):
            if inside is (token[0] == "["):
                raise unpaired
            inside = not inside
        if token[0] == "," and not inside:
            parts.append("")
        else:
            parts[-1] += token[0]
    if inside:
        raise unpaired
    return parts


def _format(value: object) -> str:
    if isinstance(value, (list, tuple)):
        return "[" + ",".join(_format(item) for item in value) + "]"
    if value is None or isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str):
        return str(value)
    plain = value.replace("_", "").replace("-", "").isalpha() and value.lower() not in _CONSTANTS
    return value if plain else f'"{value}"'


def _value(text: str, key: str, whole: str) -> Parameter:
    if not text.startswith("["):
        return _scalar(text, key, whole)
    if not text.endswith("]"):
        raise ParameterError(f"{whole!r}: {key}={text} has text after its closing bracket")
    inner = text[1:-1]
    return tuple(_scalar(item.strip(), key, whole) for item in _split(inner, whole)) if inner.strip() else ()


def _scalar(text: str, key: str, whole: str) -> Scalar:
    if len(text) >= 2 and text[0] == text[-1] == '"':
        return text[1:-1]
    if not text:
        raise ParameterError(f'{whole!r}: {key} has no value; an empty text is written ""')
    if '"' in text or "]" in text or "[" in text:
        raise ParameterError(f"{whole!r}: {key} has more than one value: {text}")
    if text.lower() in _CONSTANTS:
        return _CONSTANTS[text.lower()]
    if _INTEGER.fullmatch(text):
        return int(text)
    if _NUMBER.fullmatch(text):
        number = float(text)
        if not math.isfinite(number):
            raise ParameterError(f"{whole!r}: {key}={text} is too large for a number")
        return number
    return text
