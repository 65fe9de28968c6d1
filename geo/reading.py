"""Reads users' files up to a size limit, and words the errors of JSON and TOML for users."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geo.errors import WbfMissionError
from geo.texts import one_line

if TYPE_CHECKING:
    import msgspec

MAX_TEXT_BYTES = 1 << 20  # Texts that people write by hand are smaller


class UnreadableError(WbfMissionError, ValueError):
    """Error of a file that cannot be read. The error's text is the reason, without the file's name."""


def read_file(path: Path, max_bytes: int) -> bytes:
    """Return the bytes of a regular file of at most `max_bytes`; otherwise raise UnreadableError.

    Examples
    --------
    >>> read_file(Path("/dev/zero"), 100)
    Traceback (most recent call last):
        ...
    geo.reading.UnreadableError: it is a folder, a pipe or a device, no file
    """
    try:
        if path.exists() and not path.is_file():
            raise UnreadableError("it is a folder, a pipe or a device, no file")
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as error:
        raise UnreadableError((error.strerror or str(error)).lower()) from error
    except UnreadableError:
        raise
    except ValueError as error:  # The file's name contains a NUL character
        raise UnreadableError("there is a NUL character in its name") from error
    if len(data) > max_bytes:
        raise UnreadableError(f"it is larger than {max_bytes / 2**20:g} MiB")
    return data


def read_text(path: Path, max_bytes: int = MAX_TEXT_BYTES) -> str:
    """Return a file's UTF-8 text; raise UnreadableError as `read_file` does, or if the text is not UTF-8."""
    try:
        return read_file(path, max_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableError(f"it is not UTF-8 text (byte {error.start}); save it as UTF-8") from error


def read_toml(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file; raise UnreadableError as `read_text` does, or for invalid TOML."""
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UnreadableError(f"it is not TOML ({not_toml(error)})") from error
    except ValueError as error:  # Python converts at most 4300 digits to a whole number
        raise UnreadableError("a whole number in it has thousands of digits; correct it") from error
    except RecursionError as error:
        raise UnreadableError("its tables or lists are nested too deeply") from error


_TYPES = {
    "object": "a table of names and values",
    "array": "a list",
    "int": "a whole number",
    "float": "a number",
    "str": "a text",
    "bool": "true or false",
    "null": "null",
}
_SEPARATOR = b"\x1e"  # Record separator of RFC 8142
_NO_NUMBER = re.compile(rb"-?(NaN|nan|Infinity|inf)\b")
_BYTE = re.compile(r"\(byte (\d+)\)")
_SYNTAX = {
    "expected ':'": "a colon is missing",
    "trailing characters": "text follows the end of the document",
    "trailing comma in object": "a comma stands before a closing brace",
    "trailing comma in array": "a comma stands before a closing bracket",
    "object keys must be strings": "a name has to stand in double quotes",
    "invalid escape character in string": "a backslash stands before a character that cannot follow it",
    "invalid number": "JSON has no such number",
}


def place_in_words(path: str) -> str:
    """Return the path of a document's part as readable text, with list entries counted from 1.

    `path` is made of names joined by dots and of list indices, counted from 0, in brackets.

    Examples
    --------
    >>> place_in_words("mission.items[0].command"), place_in_words("geoFence.polygons[1].polygon[2]")
    ('mission, item 1, command', 'geoFence, polygon 2, polygon, entry 3')
    """
    words: list[str] = []
    for name, entry in re.findall(r"([^.\[\]]+)|\[([^\]]*)\]", path):
        if name:
            words.append(name)
        elif not entry.isdigit():
            words.append("an entry")
        elif words and words[-1].endswith("s"):
            words[-1] = f"{words[-1].removesuffix('s')} {int(entry) + 1}"
        else:
            words.append(f"entry {int(entry) + 1}")
    return ", ".join(words)


def misfit(error: msgspec.ValidationError, path: str = "") -> str:
    """Return msgspec's validation error as readable text that begins with the place of the fault.

    `path` is the path from the document to the part that msgspec converted, written as for `place_in_words`.

    Examples
    --------
    >>> import msgspec
    >>> def complaint(document, wanted):
    ...     try:
    ...         msgspec.convert(document, wanted)
    ...     except msgspec.ValidationError as error:
    ...         return misfit(error)
    >>> complaint([1, "two"], list[int]), complaint(1.5, int)
    ('entry 2: it is a text; give a whole number', 'it is a number with a fraction; give a whole number')
    """
    message, _, where = str(error).rpartition(" - at ")
    if not message:
        message, where = where, ""
    inner = where.rpartition("`$")[2].strip("`")
    place = place_in_words((path + inner).removeprefix("."))
    text = _in_words(message)
    return one_line(f"{place}: {text}" if place else text)


def not_json(error: msgspec.DecodeError | ValueError, data: bytes, line: int = 1) -> str:
    r"""Return an error of `msgspec.json.decode` as readable text with the fault's line and column.

    `line` is the number of the file's line on which the document begins.

    Examples
    --------
    >>> import msgspec
    >>> def complaint(document):
    ...     try:
    ...         msgspec.json.decode(document)
    ...     except ValueError as error:
    ...         return not_json(error, document)
    >>> complaint(b'{"a": 1,'), complaint(b'{"a":\n  NaN}')
    ('line 1: it ends in the middle', 'line 2, column 3: NaN is not a number in JSON; write null')
    """
    if isinstance(error, UnicodeDecodeError):
        return "it holds bytes that are not UTF-8 text; save it as UTF-8"
    found = _BYTE.search(str(error))
    if found is None:
        if "out of range" in str(error):
            return "a number in it is too large"
        lines = data.count(b"\n") + line
        return f"line {lines}: it ends in the middle"
    at = int(found[1])
    message = str(error).removeprefix("JSON is malformed: ").removesuffix(found[0]).strip()
    if message == "trailing characters" or data[at - 1 : at] == b"-":
        at -= 1  # msgspec names the byte after the fault
    line, column = data.count(b"\n", 0, at) + line, at - data.rfind(b"\n", 0, at)
    if number := _NO_NUMBER.match(data, at):
        text = f"{number[0].decode()} is not a number in JSON; write null"
    elif message == "invalid character":
        shown = data[at : at + 1].decode("ascii", "backslashreplace")
        text = f"{shown!r} is not allowed here" if shown else "it ends in the middle"
    else:
        text = _SYNTAX.get(message, message)
    return one_line(f"line {line}, column {column}: {text}")


def not_toml(error: tomllib.TOMLDecodeError) -> str:
    """Return an error of `tomllib` as readable text that begins with the place of the fault.

    Examples
    --------
    >>> import tomllib
    >>> try:
    ...     tomllib.loads("a = 1" + chr(10) + "b = ?")
    ... except tomllib.TOMLDecodeError as error:
    ...     not_toml(error)
    'line 2, column 5: invalid value'
    """
    found = re.fullmatch(r"(.*) \(at (line \d+, column \d+|end of document)\)", str(error), re.DOTALL)
    if found is None:
        return one_line(str(error))
    return one_line(f"{found[2]}: {found[1][:1].lower()}{found[1][1:]}")


def _in_words(text: str) -> str:
    """Return a message of msgspec, from which the place is cut off, as readable text."""
    if found := re.fullmatch(r"Object missing required field `(.*)`", text):
        return f"{found[1]} is missing"
    if found := re.fullmatch(r"Object contains unknown field `(.*)`", text):
        return f"{found[1]} is unknown; leave it out"
    if found := re.fullmatch(r"Invalid (?:enum )?value (.*)", text):
        return f"{found[1]} is unknown"
    if found := re.fullmatch(r"Expected `([^`]*)`(?:, got `([^`]*)`)?(?: of length (.*)| ([<>].*))?", text):
        wanted, got, length, limit = found.groups()
        kinds = wanted.split(" | ")
        give = " or ".join(_TYPES.get(kind, kind) for kind in kinds)
        if length:
            length = length.partition(", got ")[0]
            few = length.removeprefix("<= ")
            return f"give {give} with {'at most ' if few != length else ''}{few} entries"
        if limit:
            return f"it is out of range; give {give} {limit.replace('.0', '')}"
        if got is None:
            return f"give {give}"
        is_now = "a number with a fraction" if (got, wanted) == ("float", "int") else _TYPES.get(got, got)
        return f"it is {is_now}; give {give}"
    return "it is out of range" if text.endswith("out of range") else text.replace("`", "")


def json_texts(data: bytes) -> Iterator[tuple[int, bytes]]:
    r"""Yield each JSON text of a file with the number of the text's first line.

    A file has several texts if its first line is already a complete text, or if record separators (RFC 8142)
    divide the file.

    Examples
    --------
    >>> list(json_texts(b'{"a":\n 1}')), list(json_texts(b'{"a": 1}\r\n\n{"b": 2}\n'))
    ([(1, b'{"a":\n 1}')], [(1, b'{"a": 1}\r'), (3, b'{"b": 2}')])
    """
    import msgspec

    separator = _SEPARATOR if data.lstrip().startswith(_SEPARATOR) else b"\n"
    if separator == b"\n":
        first, _, others = data.lstrip().partition(b"\n")
        try:
            msgspec.json.decode(first, type=msgspec.Raw)
        except (ValueError, RecursionError):
            others = b""
        if not others.strip():
            yield 1, data
            return
    line = 1
    for part in data.split(separator):
        if part.strip():
            yield line, part
        line += part.count(b"\n") + (separator == b"\n")
