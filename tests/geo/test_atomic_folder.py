"""A process that is killed anywhere leaves the older content or the newer, and nobody writes it meanwhile."""

import errno
import fcntl
import os
import signal
import sys
from pathlib import Path

import pytest

from geo.atomic import AtomicFolder, FolderError, settle

NAMES = ("mark", "values", "picture")


def is_ours(name: str) -> bool:
    return name in NAMES


def fill(target: Path, text: str, names: tuple[str, ...] = NAMES) -> None:
    with AtomicFolder(target, "mark", is_ours) as folder:
        for name in names:
            (folder.filled / name).write_text(text)
        folder.commit()


def content(target: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in target.iterdir()}


def killed_at(number: int, target: Path, *, inside: bool) -> bool:
    """Fill the folder anew in a process that is killed at its n-th change of the disk; whether it was."""
    child = os.fork()
    if child == 0:
        left = [number]

        def count(event: str, _: tuple[object, ...]) -> None:
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


@pytest.mark.parametrize("inside", [False, True], ids=["swapped", "in use"])
@pytest.mark.parametrize("next_inside", [False, True], ids=["then swapped", "then in use"])
def test_killed_anywhere_there_is_the_older_or_the_newer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, inside: bool, next_inside: bool
) -> None:
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


def test_one_process_at_a_time_and_the_lock_goes_with_it(tmp_path: Path) -> None:
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


def test_a_disk_without_locks_is_written_and_one_that_fails_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    number = errno.ENOLCK

    def fails(descriptor: int, operation: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", fails)
    fill(tmp_path / "result", "new")
    assert [path.name for path in tmp_path.iterdir()] == ["result"]
    number = errno.EIO
    with pytest.raises(FolderError, match="it cannot be written: input/output error"):
        fill(tmp_path / "result", "newer")
    assert (tmp_path / "result" / "mark").read_text() == "new"


def test_a_lock_whose_file_is_removed_meanwhile_is_taken_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever opens the next file would have a lock of its own."""
    lock, left = fcntl.flock, [1, 2]
    path = tmp_path / ".result.lock"

    def late(descriptor: int, operation: int) -> None:
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


def test_what_is_not_committed_leaves_nothing(tmp_path: Path) -> None:
    with AtomicFolder(tmp_path / "a" / "b" / "result", "mark", is_ours) as folder:
        (folder.filled / "mark").write_text("new")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FolderError, match="cannot be written"):
        fill(Path("/proc/result"), "new")


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("fails", [1, 2, 3, 4, 5, 6])
def test_a_disk_that_refuses_leaves_the_older_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: int, *, inside: bool
) -> None:
    target = tmp_path / "result"
    fill(target, "old")
    (target / "notes").write_text("mine")
    before = content(target)
    if inside:
        monkeypatch.chdir(target)
    left = [fails]
    rename = os.replace

    def refuse(source: object, destination: object, **more: object) -> None:
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


def test_a_name_as_long_as_names_can_be(tmp_path: Path) -> None:
    fill(tmp_path / ("n" * 255), "new")
    assert [path.name for path in tmp_path.iterdir()] == ["n" * 255]
