"""Files that appear complete or not at all."""

import errno
import os
import resource
from pathlib import Path

import pytest

from geo.atomic import AtomicFolder, atomic_path, atomic_write


def entries(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def test_text_and_bytes(tmp_path):
    with atomic_write(tmp_path / "a.txt") as file:
        file.write("grün\n")
    with atomic_write(str(tmp_path / "b.bin"), "wb") as file:
        file.write(b"\x00\xff")
    assert (tmp_path / "a.txt").read_bytes() == "grün\n".encode()
    assert (tmp_path / "b.bin").read_bytes() == b"\x00\xff"
    assert entries(tmp_path) == ["a.txt", "b.bin"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_older_file_survives_a_failure(tmp_path, error):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(error), atomic_write(path) as file:
        file.write("new")
        raise error
    assert path.read_text() == "old"
    assert entries(tmp_path) == ["a.txt"]


def test_permissions_and_links_are_kept(tmp_path):
    real = tmp_path / "real.txt"
    real.write_text("old")
    real.chmod(0o640)
    link = tmp_path / "link.txt"
    link.symlink_to(real)
    with atomic_write(link) as file:
        file.write("new")
    assert link.is_symlink()
    assert real.read_text() == "new"
    assert real.stat().st_mode & 0o777 == 0o640


def test_new_file_obeys_the_umask(tmp_path):
    old = os.umask(0o027)
    try:
        with atomic_write(tmp_path / "a.txt") as file:
            file.write("new")
    finally:
        os.umask(old)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_errors_name_the_target(tmp_path):
    target = tmp_path / "missing" / "a.txt"
    with pytest.raises(FileNotFoundError) as caught, atomic_write(target) as file:
        file.write("new")
    assert caught.value.filename == str(target)
    with pytest.raises(IsADirectoryError), atomic_write(tmp_path) as file:
        file.write("new")


def test_path_keeps_the_suffix_and_survives_long_names(tmp_path):
    target = tmp_path / ("n" * 250 + ".png")
    with atomic_path(target) as temporary:
        assert temporary.suffix == ".png"
        assert temporary.parent == tmp_path
        temporary.write_bytes(b"png")
    assert target.read_bytes() == b"png"


def test_a_device_is_written_directly():
    with atomic_write("/dev/null") as file:
        file.write("gone")
    assert not Path("/dev/null").is_file()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO, errno.EDQUOT])
def test_a_full_disk_names_the_file_and_leaves_nothing(tmp_path, monkeypatch, number):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def full(descriptor):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"a\.txt") as caught, atomic_write(target) as file:
        file.write("new")
    assert (caught.value.errno, caught.value.filename) == (number, str(target))
    assert target.read_text() == "old"
    assert entries(tmp_path) == ["a.txt"]


def test_a_write_that_the_system_stops_names_the_file(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with (
            pytest.raises(OSError, match=r"a\.bin") as caught,
            atomic_write(tmp_path / "a.bin", "wb") as file,
        ):
            file.write(b"x" * 100_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.errno == errno.EFBIG
    assert entries(tmp_path) == []


def test_file_and_folder_are_on_the_disk_before_it_is_said(tmp_path, monkeypatch):
    done = []

    def seen(descriptor):
        done.append((Path(f"/proc/self/fd/{descriptor}").readlink(), (tmp_path / "a.txt").exists()))

    monkeypatch.setattr(os, "fsync", seen)
    with atomic_write(tmp_path / "a.txt") as file:
        file.write("new")
    (first, there), (second, after) = done
    assert (first.parent, there) == (tmp_path, False)
    assert (second, after) == (tmp_path, True)


def test_a_file_system_that_cannot_sync_is_written_all_the_same(tmp_path, monkeypatch):
    def unable(descriptor):
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr(os, "fsync", unable)
    with atomic_write(tmp_path / "a.txt") as file:
        file.write("new")
    assert (tmp_path / "a.txt").read_text() == "new"


@pytest.fixture
def opened_elsewhere(monkeypatch):
    """Refuse renames over a file as Windows does while a program has it open; yields the refusals to come."""
    refusals, rename = [], Path.replace

    def refusing(self, target):
        if refusals and Path(target).exists():
            raise refusals.pop()
        return rename(self, target)

    monkeypatch.setattr(Path, "replace", refusing)
    monkeypatch.setattr("geo.atomic.time.sleep", lambda _: None)
    return refusals


def test_a_file_that_is_open_elsewhere_for_a_moment_is_replaced(tmp_path, opened_elsewhere):
    path = tmp_path / "a.txt"
    path.write_text("old")
    opened_elsewhere += [PermissionError(errno.EACCES, "Access is denied")] * 3
    with atomic_write(path) as file:
        file.write("new")
    assert path.read_text() == "new"
    assert not opened_elsewhere
    assert entries(tmp_path) == ["a.txt"]


def test_a_file_that_stays_open_elsewhere_is_left_whole(tmp_path, opened_elsewhere):
    path = tmp_path / "a.txt"
    path.write_text("old")
    opened_elsewhere += [PermissionError(errno.EACCES, "Access is denied")] * 99
    open_elsewhere = pytest.raises(PermissionError, match="close any program that has it open")
    with open_elsewhere as caught, atomic_write(path) as file:
        file.write("new")
    assert caught.value.filename == str(path)
    assert path.read_text() == "old"
    assert entries(tmp_path) == ["a.txt"]


def test_a_folder_with_a_file_that_is_open_elsewhere_is_left_whole(tmp_path, monkeypatch):
    path, rename = tmp_path / "run", Path.replace
    path.mkdir()
    (path / "mark").write_text("old")

    def refusing(self, target):
        if self == path:
            raise PermissionError(errno.EACCES, "Access is denied", str(self), None, str(target))
        return rename(self, target)

    monkeypatch.setattr(Path, "replace", refusing)
    monkeypatch.setattr("geo.atomic.time.sleep", lambda _: None)
    open_elsewhere = pytest.raises(PermissionError, match="close any program that has it open")
    with open_elsewhere as caught, AtomicFolder(path, "mark", lambda _: True) as folder:
        (folder.filled / "mark").write_text("new")
        folder.commit()
    assert caught.value.filename == str(path)
    assert (path / "mark").read_text() == "old"
    assert entries(tmp_path) == ["run"]
