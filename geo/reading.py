"""Files that a user names, read with care: a pipe, a device or a huge file is refused, not waited for."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from geo.decoding import not_toml
from geo.errors import WbfMissionError

__all__ = ["UnreadableError", "read_file", "read_text", "read_toml"]

MAX_TEXT_BYTES = 1 << 20


class UnreadableError(WbfMissionError, ValueError):
    """A file that cannot be read; the text is the reason, without the file's name."""


def read_file(path: Path, max_bytes: int) -> bytes:
    """The bytes of a regular file.

    Examples
    --------
    >>> read_file(Path("/dev/zero"), 100)
    Traceback (most recent call last):
        ...
    geo.reading.UnreadableError: it is a folder, a pipe or a device, no file
    """
    try:
        if path.exists() and not path.is_file():
            msg = "it is a folder, a pipe or a device, no file"
            raise UnreadableError(msg)
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as error:
        raise UnreadableError((error.strerror or str(error)).lower()) from error
    except UnreadableError:
        raise
    except ValueError as error:  # a NUL in the name
        raise UnreadableError("there is a NUL character in its name") from error
    if len(data) > max_bytes:
        raise UnreadableError(f"it is larger than {max_bytes / 2**20:g} MiB")
    return data


def read_text(path: Path, max_bytes: int = MAX_TEXT_BYTES) -> str:
    """The text of a regular UTF-8 file; UnreadableError as for `read_file`, or if it is not UTF-8."""
    try:
        return read_file(path, max_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableError(f"it is not UTF-8 text (byte {error.start})") from error


def read_toml(path: Path, max_bytes: int = MAX_TEXT_BYTES) -> dict[str, Any]:
    """The table of a TOML file; UnreadableError as for `read_text`, or if it is not TOML."""
    text = read_text(path, max_bytes)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UnreadableError(f"it is not TOML ({not_toml(error)})") from error
    except RecursionError as error:
        raise UnreadableError("its tables or lists are nested too deeply") from error
