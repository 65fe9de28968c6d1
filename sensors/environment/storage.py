"""Saves and loads environments in folders, which appear complete or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from geo.atomic import lock_held
from sensors.environment.environment import Environment
from sensors.environment.store import HEADER, EnvironmentStore, Header, open_store, read_header
from sensors.errors import EnvironmentDataError


def save_environment(environment: Environment, path: str | os.PathLike[str]) -> None:
    """Save an environment atomically to a folder (`docs/environment.md`).

    An older environment in the folder is replaced. Raise EnvironmentDataError if the folder has other content
    or cannot be written.
    """
    header = Header.of(environment.shape, environment.days, environment.fields, environment.provenance)
    with unfinished_store(path, header) as store:
        for field in environment.fields.diseases:
            store.write_onset(field.name, environment.onset(field.name))
        for field in environment.fields.continuous:
            for day in environment.days:
                store.write_level(field.name, day, environment.level(field.name, day))


def load_environment(path: str | os.PathLike[str], *, lazy: bool = True) -> Environment:
    """Load an environment from a folder that `save_environment` or `generate_environment` wrote.

    With `lazy`, data are decoded on demand, not all at once. If a file is missing or invalid, raise
    EnvironmentDataError, which names the file. Later decoding may also raise EnvironmentDataError.
    """
    store = open_store(path)
    store.check()
    return store.environment(lazy=lazy)


def stored_environment(path: str | os.PathLike[str], header: Header) -> Environment | None:
    """Return the environment at `path` if it is complete and has this header, or else None."""
    try:
        store = open_store(path)
        if store.header != header:
            return None
        store.check()
    except EnvironmentDataError:
        return None
    return store.environment()


@contextlib.contextmanager
def unfinished_store(
    path: str | os.PathLike[str], header: Header, *, resume: bool = False
) -> Iterator[EnvironmentStore]:
    """Yield a store beside `path`, which is moved to `path` when the block ends without an exception.

    After an exception, Ctrl-C included, an older environment at `path` is unchanged, and finished parts of
    the new environment are kept. A later call with `resume` and the same header continues with these parts.
    Raise EnvironmentDataError if the folder `path` holds anything but an older environment, cannot be
    written, or is being written by another process.
    """
    target = Path(path).resolve()
    try:
        _check_target(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        partial = target.with_name(f".{target.name}.partial")
        with _locked(target):
            partial.mkdir(exist_ok=True)
            store = EnvironmentStore(partial, header, writable=True)
            if not (resume and _is_started(store)):
                for entry in partial.iterdir():
                    shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
                store.create()
            yield store
            for stray in partial.rglob("*.partial"):
                stray.unlink()
            _replace(partial, target)
    except OSError as error:
        raise EnvironmentDataError(f"{path}: cannot be written: {error.strerror or error}") from error


def _check_target(target: Path) -> None:
    if target.is_dir() and any(target.iterdir()):
        try:
            read_header(target)
        except EnvironmentDataError as error:
            if _looks_like_ours(target):
                return
            msg = f"{target}: this folder holds something other than an environment; give another folder"
            raise EnvironmentDataError(msg) from error
    elif target.exists() and not target.is_dir():
        raise NotADirectoryError(20, "a file has this name; remove it")


def _looks_like_ours(target: Path) -> bool:
    """Return whether a folder without a valid header holds an older version's or a damaged environment."""
    if (target / "environment.json").is_file() and (target / "tylcv.npy").is_file():
        return True
    arrays = [path.parent.name for path in target.glob(f"*/{HEADER}")]
    return "day" in arrays and len(arrays) > 1


@contextlib.contextmanager
def _locked(target: Path) -> Iterator[None]:
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(lock_held(target.with_name(f".{target.name}.lock")))
        except BlockingIOError as error:
            msg = f"{target}: another process is writing this environment; wait until it has finished"
            raise EnvironmentDataError(msg) from error
        yield


def _is_started(store: EnvironmentStore) -> bool:
    try:
        if read_header(store.folder) != store.header:
            return False
        for name in store.fields.names:
            store.array(name)
    except EnvironmentDataError:
        return False
    return (store.folder / "day" / "c" / "0").is_file()


def _replace(partial: Path, target: Path) -> None:
    older = target.with_name(f".{target.name}.older")
    shutil.rmtree(older, ignore_errors=True)
    if target.exists():
        target.replace(older)
    try:
        partial.replace(target)
    except OSError:
        if older.exists():
            older.replace(target)
        raise
    shutil.rmtree(older, ignore_errors=True)
