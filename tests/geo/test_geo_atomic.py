"""Files that appear complete or not at all."""

import errno
import fcntl
import os
import signal
import sys
from pathlib import Path

import pytest
from sweeps import slow

from geo.atomic import AtomicFolder, FolderError, atomic_path, atomic_write, settle


def entries(folder):
    return sorted(entry.name for entry in folder.iterdir())


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


# Folders: a process that is killed anywhere leaves the older content or the newer

NAMES = ("mark", "values", "picture")


def is_ours(name):
    return name in NAMES


def fill(target, text, names=NAMES):
    with AtomicFolder(target, "mark", is_ours) as folder:
        for name in names:
            (folder.filled / name).write_text(text)
        folder.commit()


def content(target):
    return {path.name: path.read_text() for path in target.iterdir()}


def killed_at(number, target, *, inside):
    """Fill the folder anew in a process that is killed at its n-th change of the disk; whether it was."""
    child = os.fork()
    if child == 0:
        left = [number]

        def count(event, _):
            if event in ("os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.chmod", "shutil.rmtree"):
                left[0] -= 1
                if left[0] == 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        if inside:
            os.chdir(target)
        sys.addaudithook(count)
        fill(target, "new", ("mark", "values"))
        os._exit(0)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


@pytest.mark.parametrize(
    ("inside", "next_inside"), [(False, True), (True, False), slow(False, False), slow(True, True)]
)
def test_killed_anywhere_there_is_the_older_or_the_newer(tmp_path, monkeypatch, inside, next_inside):
    target = tmp_path / "result"
    older = {**dict.fromkeys(NAMES, "old"), "notes": "mine"}
    newer = {"mark": "new", "values": "new", "notes": "mine"}
    seen = []
    number = 0
    while True:
        number += 1
        monkeypatch.chdir("/")
        fill(target, "old")
        (target / "notes").write_text("mine")
        was_killed = killed_at(number, target, inside=inside)
        if next_inside and target.is_dir():
            monkeypatch.chdir(target)
        settle(target, "mark", is_ours)
        found = content(target)
        assert found in (older, newer), number
        seen.append(found == newer)
        # And whoever writes it next finds it free.
        fill(target, "last")
        assert content(target) == {**dict.fromkeys(NAMES, "last"), "notes": "mine"}
        assert [path.name for path in tmp_path.iterdir()] == ["result"]
        if not was_killed:
            break
    assert number > 7
    assert seen == sorted(seen), "once it is committed, it comes"
    assert True in seen[:-1] and False in seen


def test_one_process_at_a_time_and_the_lock_goes_with_it(tmp_path):
    target = tmp_path / "result"
    with AtomicFolder(target, "mark", is_ours):
        with pytest.raises(FolderError, match="another run writes into this folder"):
            fill(target, "other")
        settle(target, "mark", is_ours)
    child = os.fork()
    if child == 0:
        with AtomicFolder(target, "mark", is_ours):
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".result.lock", ".result.partial"]
    fill(target, "new")
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_a_disk_without_locks_is_written_and_one_that_fails_is_not(tmp_path, monkeypatch):
    number = errno.ENOLCK

    def fails(descriptor, operation):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", fails)
    fill(tmp_path / "result", "new")
    assert [path.name for path in tmp_path.iterdir()] == ["result"]
    number = errno.EIO
    with pytest.raises(FolderError, match="it cannot be written: input/output error"):
        fill(tmp_path / "result", "newer")
    assert (tmp_path / "result" / "mark").read_text() == "new"


def test_a_lock_whose_file_is_removed_meanwhile_is_taken_again(tmp_path, monkeypatch):
    """Whoever opens the next file would have a lock of its own."""
    lock, left = fcntl.flock, [1, 2]
    path = tmp_path / ".result.lock"

    def late(descriptor, operation):
        lock(descriptor, operation)
        if left:
            path.unlink()
            if left.pop() == 1:
                path.touch()

    monkeypatch.setattr("fcntl.flock", late)
    with AtomicFolder(tmp_path / "result", "mark", is_ours):
        assert left == []
        with pytest.raises(FolderError, match="another run"):
            fill(tmp_path / "result", "other")


def test_what_is_not_committed_leaves_nothing(tmp_path):
    with AtomicFolder(tmp_path / "a" / "b" / "result", "mark", is_ours) as folder:
        (folder.filled / "mark").write_text("new")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FolderError, match="cannot be written"):
        fill(Path("/proc/result"), "new")


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("fails", [1, 2, 3, 4, 5, 6])
def test_a_disk_that_refuses_leaves_the_older_one(tmp_path, monkeypatch, fails, *, inside):
    target = tmp_path / "result"
    fill(target, "old")
    (target / "notes").write_text("mine")
    before = content(target)
    if inside:
        monkeypatch.chdir(target)
    left = [fails]
    rename = os.replace

    def refuse(source, destination, **more):
        left[0] -= 1
        if left[0] == 0:
            raise OSError(28, "No space left on device", source)
        rename(source, destination, **more)

    monkeypatch.setattr(os, "replace", refuse)
    failed = False
    try:
        fill(target, "new")
    except OSError:
        failed = True
    monkeypatch.setattr(os, "replace", rename)
    settle(target, "mark", is_ours)
    newer = {**dict.fromkeys(NAMES, "new"), "notes": "mine"}
    assert content(target) in ((before, newer) if failed else (newer,))
    if failed and fails <= 2:
        assert content(target) == before
    fill(target, "last")
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_a_name_as_long_as_names_can_be(tmp_path):
    fill(tmp_path / ("n" * 255), "new")
    assert [path.name for path in tmp_path.iterdir()] == ["n" * 255]
