"""File system of a vehicle: a tree in memory, of limited size, with files that are generated on reading."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import IntEnum

_MOST_ENTRIES = 512
_MOST_BYTES = 4_000_000
_MOST_DEPTH = 8

MadeFile = Callable[[str, int], bytes | None]
"""``make(query, read_size)`` returns the contents of a generated file; None if the query is invalid."""
TakenFile = Callable[[bytes], bool]
Mounted = Callable[[], Mapping[str, bytes | bytearray]]
Path = tuple[str, ...]


class FtpError(IntEnum):
    """Error codes of MAVLink FTP."""

    FAIL = 1
    INVALID_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    PROTECTED = 9
    NOT_FOUND = 10


class FileError(Exception):
    """A file operation failed; `code` is the reason."""

    def __init__(self, code: FtpError) -> None:
        super().__init__(code.name)
        self.code = code


def path_of(text: str) -> Path:
    """Split a path from the root into its parts, without ``.`` and empty parts; FileError for ``..``.

    >>> path_of("/fs/./microsd//log/")
    ('fs', 'microsd', 'log')
    """
    steps = tuple(step for step in text.split("/") if step not in ("", "."))
    if ".." in steps or len(steps) > _MOST_DEPTH:
        raise FileError(FtpError.NOT_FOUND)
    return steps


class FileTree:
    """Directories and files of a vehicle; methods raise FileError on failure.

    Files can be written in ``directories`` and below. ``made`` maps the path of a generated file to a
    function that returns its contents. ``taken`` maps the path of an upload to a function that receives the
    contents, and returns whether it accepts them. ``mounted`` maps a directory to a function that returns the
    read-only files of this directory, keyed by path.
    """

    def __init__(
        self,
        directories: tuple[str, ...] = (),
        made: Mapping[str, MadeFile] | None = None,
        mounted: Mapping[str, Mounted] | None = None,
        taken: Mapping[str, TakenFile] | None = None,
    ) -> None:
        self._taken = {path_of(path): take for path, take in (taken or {}).items()}
        self._mounted = {path_of(path): contents for path, contents in (mounted or {}).items()}
        self._made = {path_of(path): make for path, make in (made or {}).items()}
        self._files: dict[Path, bytearray] = {}
        self._writable = {path_of(path) for path in directories}
        read_only = [path[:-1] for path in self._made]
        self._directories = {
            path[:depth] for path in (*self._writable, *read_only) for depth in range(len(path) + 1)
        }

    def names(self, text: str) -> list[str]:
        """Return the entries of a directory in LIST format: ``Dname``, or ``Fname`` with the size."""
        path = path_of(text)
        mounted = self._mounted_files()
        depth = len(path)
        directories = self._directories | {file[:i] for file in mounted for i in range(1, len(file))}
        if path not in directories:
            raise FileError(FtpError.NOT_FOUND)

        def within(other: Path) -> bool:
            return len(other) == depth + 1 and other[:depth] == path

        entries = [f"D{other[-1]}" for other in directories if within(other)]
        for kept in (self._files, mounted):
            entries += [f"F{other[-1]}\t{len(data)}" for other, data in kept.items() if within(other)]
        entries += [f"F{o[-1]}\t{len(make('', 0) or b'')}" for o, make in self._made.items() if within(o)]
        return sorted(entries)

    def opened(self, text: str) -> Callable[[int], bytes | None]:
        """Return a function that returns the file's contents; its argument is the size of the first read."""
        name, _, query = text.partition("?")
        path = path_of(name)
        if path in self._made:
            make = self._made[path]
            return lambda size: make(query, size)
        kept = self._files.get(path, self._mounted_files().get(path))
        if kept is None or query:
            raise FileError(FtpError.NOT_FOUND)
        contents = bytes(kept)
        return lambda _size: contents

    def create(self, text: str, *, anew: bool) -> Path:
        """Create a file or open an existing file, and return its path; `anew` empties an existing file."""
        path = path_of(text)
        if path not in self._taken:
            path = self._place(text)
        if path in self._directories:
            raise FileError(FtpError.FILE_EXISTS)
        if path not in self._files:
            self._check_room(0)
            self._files[path] = bytearray()
        elif anew:
            self._files[path].clear()
        return path

    def write(self, path: Path, offset: int, data: bytes) -> None:
        """Write `data` at `offset`; a gap between the end of the file and `offset` is filled with zeros."""
        kept = self._files.get(path)
        if kept is None:
            raise FileError(FtpError.NOT_FOUND)
        end = offset + len(data)
        if end > len(kept):
            self._check_room(end - len(kept))
            kept.extend(bytes(end - len(kept)))
        kept[offset:end] = data

    def close(self, path: Path) -> None:
        """Close a written file; pass an upload to the vehicle, with FileError if the vehicle refuses it."""
        if path in self._taken and not self._taken[path](bytes(self._files.pop(path, b""))):
            raise FileError(FtpError.FAIL)

    def truncate(self, text: str, size: int) -> None:
        """Shorten a file to `size` bytes."""
        kept = self._files.get(self._place(text))
        if kept is None:
            raise FileError(FtpError.NOT_FOUND)
        if size > len(kept):
            raise FileError(FtpError.FAIL)
        del kept[size:]

    def remove(self, text: str) -> None:
        """Delete a file."""
        if self._files.pop(self._place(text), None) is None:
            raise FileError(FtpError.NOT_FOUND)

    def make_directory(self, text: str) -> None:
        """Create a directory."""
        path = self._place(text)
        if path in self._directories or path in self._files:
            raise FileError(FtpError.FILE_EXISTS)
        self._check_room(0)
        self._directories.add(path)

    def remove_directory(self, text: str) -> None:
        """Delete an empty directory."""
        path = self._place(text)
        if path not in self._directories:
            raise FileError(FtpError.NOT_FOUND)
        if path in self._writable or self.names(text):
            raise FileError(FtpError.FAIL)
        self._directories.remove(path)

    def rename(self, old: str, new: str) -> None:
        """Move a file to another path."""
        before, after = self._place(old), self._place(new)
        if before not in self._files:
            raise FileError(FtpError.NOT_FOUND)
        if after in self._files or after in self._directories:
            raise FileError(FtpError.FILE_EXISTS)
        self._files[after] = self._files.pop(before)

    def _mounted_files(self) -> dict[Path, bytes | bytearray]:
        return {
            (*directory, *path_of(below)): data
            for directory, contents in self._mounted.items()
            for below, data in contents().items()
        }

    def _place(self, text: str) -> Path:
        """Return the parts of a path; FileError unless the path is in a writable directory."""
        path = path_of(text)
        if any(path in kept for kept in (self._made, self._taken, self._mounted_files())):
            raise FileError(FtpError.PROTECTED)
        if not any(path[: len(root)] == root for root in self._writable):
            raise FileError(FtpError.PROTECTED)
        if path not in self._directories and path[:-1] not in self._directories:
            raise FileError(FtpError.NOT_FOUND)
        return path

    def _check_room(self, more: int) -> None:
        entries = len(self._files) + len(self._directories)
        if entries >= _MOST_ENTRIES or sum(map(len, self._files.values())) + more > _MOST_BYTES:
            raise FileError(FtpError.FAIL)
