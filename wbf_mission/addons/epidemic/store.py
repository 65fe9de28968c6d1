"""Keeps trained networks in memory and in files, and trains missing networks."""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geo.atomic import atomic_write, made_by_one
from geo.processes import CallsAhead
from geo.system import user_cache_folder, warn_of_cache
from sensors.estimators.base import Step, no_step
from wbf_mission.addons.epidemic.network import Network
from wbf_mission.addons.epidemic.training import FURTHER, FURTHER_LAYERS, LAYERS, TrainingTask, learn

SUMS = 2
"""Version in file names; raise it if the arithmetic of the training changes, but not the random draws."""
INCLUDED = Path(__file__).parent / "networks"
"""Folder of trained networks for the Miniberry farms; `tools/write_networks.py` trains them."""

_WORTH_A_PROCESS = 1000  # Smaller trainings (outbreaks x epochs) are not worth a separate process.

_in_memory: dict[str, Network] = {}


def network_for(task: TrainingTask, folder: str | os.PathLike[str] | None) -> Network:
    """Return the network of a task from memory or its file; otherwise train it, and store it in both.

    An unusable file is replaced. If the folder is not writeable, every process trains again; this is not an
    error.
    """
    learn_all([task], folder)
    return _in_memory[task.key]


def learn_all(
    tasks: Sequence[TrainingTask], folder: str | os.PathLike[str] | None, step: Step = no_step
) -> None:
    """Load or train the networks of some tasks, so that they are in memory and in their files.

    `step` is called with the finished fraction, 0..1, unless all networks exist already.
    """
    if all(_is_known(task, folder) for task in tasks):
        return
    step(0.0)
    with contextlib.ExitStack() as stack:
        # All processes take the locks in the same order, so that no two wait for each other.
        for path in sorted({network_file(task, folder) for task in tasks}):
            stack.enter_context(made_by_one(path))
        missing = {task.key: task for task in tasks if not _is_known(task, folder)}
        _learn_missing(list(missing.values()), folder, step)
    if not missing:
        step(1.0)  # Another process has trained the networks in the meantime.


def _learn_missing(tasks: Sequence[TrainingTask], folder: str | os.PathLike[str] | None, step: Step) -> None:
    """Train networks: in parallel processes if all trainings are large, otherwise one after the other."""
    done = 0
    long = all(task.outbreaks * task.epochs >= _WORTH_A_PROCESS for task in tasks)
    may_have_children = (os.cpu_count() or 1) > 1 and not multiprocessing.current_process().daemon
    if len(tasks) > 1 and long and may_have_children:
        for network in _in_processes(tasks):
            _keep(network, tasks[done], folder)
            done += 1
            step(done / len(tasks))
    for task in tasks[done:]:

        def part(share: float, before: int = done) -> None:
            step((before + share) / len(tasks))

        _keep(learn(task, part), task, folder)
        done += 1


def _in_processes(tasks: Sequence[TrainingTask]) -> Iterator[Network]:
    """Yield the networks of the tasks in order; stop early if a process dies."""
    from concurrent.futures.process import BrokenProcessPool

    calls = CallsAhead(learn, [(task,) for task in tasks])
    try:
        # If a process is killed for lack of memory, the caller trains the remaining networks one by one.
        with contextlib.suppress(BrokenProcessPool):
            for number in range(len(tasks)):
                yield calls.result(number)
    finally:
        calls.close()


def network_file(task: TrainingTask, folder: str | os.PathLike[str] | None) -> Path:
    """Return the path of a task's network file, in `folder` or the user's cache."""
    parent = Path(folder) if folder is not None else user_cache_folder("epidemic")
    return parent / f"{task.key}-{SUMS}.npz"


def _is_known(task: TrainingTask, folder: str | os.PathLike[str] | None) -> bool:
    """Return whether the network of a task is in memory or in a file; load it into memory."""
    if task.key not in _in_memory:
        path = network_file(task, folder)
        network = load_network(INCLUDED / path.name) or load_network(path)
        if network is not None:
            _in_memory[task.key] = network
    return task.key in _in_memory


def _keep(network: Network, task: TrainingTask, folder: str | os.PathLike[str] | None) -> None:
    """Store the network of a task in memory and in its file."""
    save_network(network, network_file(task, folder))
    _in_memory[task.key] = network


def save_network(network: Network, path: Path) -> None:
    """Write a network to a file; warn if the folder is not writeable."""
    layers: dict[str, NDArray[np.float32]] = {}
    for number, stage in enumerate((network, *network.further)):
        layers |= {f"{_part(number)}weight{i}": weight for i, weight in enumerate(stage.weights)}
        layers |= {f"{_part(number)}bias{i}": bias for i, bias in enumerate(stage.biases)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path, "wb") as stream_:
            np.savez(stream_, allow_pickle=False, **layers)
    except OSError as error:
        warn_of_cache(path.parent, error)


def load_network(path: Path) -> Network | None:
    """Return the network in a file; None if the file is missing or unusable."""
    try:
        with np.load(path, allow_pickle=False) as file:
            first = _read(file, 0, LAYERS)
            stages = range(1, 1 + FURTHER if f"{_part(1)}weight0" in file.files else 1)
            further = [_read(file, number, FURTHER_LAYERS) for number in stages]
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile):
        return None
    return replace(first, further=tuple(further))


def _part(number: int) -> str:
    return f"further{number}_" if number else ""


def _read(file: Mapping[str, NDArray[np.float32]], number: int, layers: Sequence[int]) -> Network:
    """Return network `number` of a file; raise ValueError or KeyError if it is unusable."""
    weights, biases = [], []
    for i, shape in enumerate(itertools.pairwise(layers)):
        weight, bias = file[f"{_part(number)}weight{i}"], file[f"{_part(number)}bias{i}"]
        good = weight.shape == shape and bias.shape == shape[1:]
        good = good and weight.dtype == bias.dtype == np.float32
        if not (good and np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise ValueError(f"layer {i} is not one of {shape}")
        weights.append(weight)
        biases.append(bias)
    return Network(tuple(weights), tuple(biases))
