"""Writes ZIP archives, and reads ZIP archives of users within size limits."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from geo.system import Closing
from geo.texts import one_line

MAX_MEMBERS = 1000  # Maximum number of files in an archive.
_MEMBER = b"PK\x01\x02"  # Signature of an entry in the directory of an archive.
_UNZIP_ERRORS = (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, ValueError)


class ArchiveError(ValueError):
    """The archive is damaged or too large."""


class Archive(Closing):
    """A user's ZIP archive. Members are read into memory only; their names are never used as paths.

    `source` is a file or its content. `room` is the total number of bytes that may still be unpacked. `names`
    lists the members in their order, without the members that macOS adds (``__MACOSX/``, ``._x``).
    Raises ArchiveError if `source` is not a ZIP archive, or has more than `MAX_MEMBERS` files.
    """

    def __init__(self, source: Path | bytes, room: int) -> None:
        if isinstance(source, bytes) and source.count(_MEMBER) > MAX_MEMBERS:
            raise ArchiveError(f"holds more than {MAX_MEMBERS} files")
        self.room = self._most = room
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source)
        except _UNZIP_ERRORS as error:
            raise _damaged(error) from None
        names = self._zip.namelist()
        if len(names) > MAX_MEMBERS:
            self.close()
            raise ArchiveError(f"holds {len(names)} files, more than {MAX_MEMBERS}")
        self.names = [name for name in names if not _is_of_macos(name)]

    def read(self, name: str) -> bytes:
        """Return a member's content; ArchiveError if the member is damaged or exceeds `room`."""
        try:
            with self._zip.open(name) as member:
                data = member.read(self.room + 1)
        except _UNZIP_ERRORS as error:
            raise _damaged(error) from None
        self.room -= len(data)
        if self.room < 0:
            raise ArchiveError(f"unpacks to more than {self._most >> 20} MiB, the limit")
        return data

    def kml(self) -> tuple[list[str], str]:
        """Return a KMZ's main KML (at the root, ``doc.kml`` first), if any, and a note on the others."""
        found = [name for name in self.names if name.lower().endswith(".kml")]
        found.sort(key=lambda name: ("/" in name, name.rpartition("/")[2].lower() != "doc.kml"))
        others = one_line(", ".join(found[1:]), 100)
        return found[:1], f"read from {found[0]}; left out: {others}" if others else ""

    def close(self) -> None:
        """Close the archive's file."""
        self._zip.close()


def _is_of_macos(name: str) -> bool:
    """Return whether macOS added this member, to store attributes of another member.

    >>> [_is_of_macos(name) for name in ("__MACOSX/My Farm/._a.shp", "My Farm/._a.shp", "My Farm/a.shp")]
    [True, True, False]
    """
    return name.startswith("__MACOSX/") or name.rpartition("/")[2].startswith("._")


def _damaged(error: Exception) -> ArchiveError:
    return ArchiveError(f"cannot be unpacked ({one_line(str(error), 100)}); save it again")


def archive_of(members: Mapping[str, str | bytes]) -> bytes:
    """Return a ZIP archive of the `members`, keyed by name; equal members give equal bytes.

    >>> archive_of({"a.txt": "one"}) == archive_of({"a.txt": b"one"})
    True
    """
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            data = content.encode() if isinstance(content, str) else content
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)  # ZipInfo has a fixed date.
    return made.getvalue()
