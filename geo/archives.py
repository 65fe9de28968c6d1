"""ZIP archives of others, read with limits, and our own, of which equal content gives equal bytes."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from geo.closing import Closing
from geo.texts import one_line

MAX_MEMBERS = 1000
_RECORD = b"PK\x01\x02"
_UNREADABLE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, ValueError)


class ArchiveError(ValueError):
    """An archive that is damaged, or larger than what it is for can be."""


class Archive(Closing):
    """A ZIP archive of somebody's, whose members are read into memory; nothing is written to their names.

    Parameters
    ----------
    source : Path or bytes
        Its file or its content.
    room : int
        Bytes that may be unpacked of it, of all members together.

    Attributes
    ----------
    names : list of str
        Of its members, in their order, without what macOS adds (``__MACOSX/``, ``._x``).
    room : int
        What is left of it.

    Raises
    ------
    ArchiveError
        If it is none, or holds more than `MAX_MEMBERS` files.
    """

    def __init__(self, source: Path | bytes, room: int) -> None:
        if isinstance(source, bytes) and source.count(_RECORD) > MAX_MEMBERS:
            raise ArchiveError(f"holds more than {MAX_MEMBERS} files")
        self.room = self._most = room
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source)
        except _UNREADABLE as error:
            raise _damaged(error) from None
        names = self._zip.namelist()
        if len(names) > MAX_MEMBERS:
            self.close()
            raise ArchiveError(f"holds {len(names)} files, more than {MAX_MEMBERS}")
        self.names = [name for name in names if not _added(name)]

    def read(self, name: str) -> bytes:
        """Return what a member holds; ArchiveError if it is damaged, or larger than the room that is left."""
        try:
            with self._zip.open(name) as member:
                data = member.read(self.room + 1)
        except _UNREADABLE as error:
            raise _damaged(error) from None
        self.room -= len(data)
        if self.room < 0:
            raise ArchiveError(f"unpacks to more than {self._most >> 20} MiB, which is more than is read")
        return data

    def close(self) -> None:
        """Close the file."""
        self._zip.close()


def _added(name: str) -> bool:
    """Tell whether macOS has added a member; it is called as the one that it is of.

    >>> [_added(name) for name in ("__MACOSX/My Farm/._a.shp", "My Farm/._a.shp", "My Farm/a.shp")]
    [True, True, False]
    """
    return name.startswith("__MACOSX/") or name.rpartition("/")[2].startswith("._")


def _damaged(error: Exception) -> ArchiveError:
    return ArchiveError(f"cannot be unpacked ({one_line(str(error), 100)}); save it again")


def archive_of(members: Mapping[str, str | bytes]) -> bytes:
    """Return a ZIP archive of texts and bytes by their names; the same members give the same bytes.

    >>> archive_of({"a.txt": "one"}) == archive_of({"a.txt": b"one"})
    True
    """
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            data = content.encode() if isinstance(content, str) else content
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    return made.getvalue()
