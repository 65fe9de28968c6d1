"""Training many networks beforehand, in as many processes as the machine has cores."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo.workers import CallsAhead
from sensors.estimators.epidemic.network import Network
from sensors.estimators.epidemic.training import (
    TrainingTask,
    keep_network,
    known_network,
    learn,
    shared_task,
)

if TYPE_CHECKING:
    from sensors.estimators.base import Step

Wanted: TypeAlias = tuple[TrainingTask, NDArray[np.bool_]]
"""A task, and the crop map that it is for."""

_WORTH_A_PROCESS = 1000


def learn_all(wanted: Sequence[Wanted], folder: str | os.PathLike[str] | None, step: Step) -> None:
    """Have the networks of some tasks ready in memory and in their files; the same as one by one.

    Parameters
    ----------
    wanted : sequence of (TrainingTask, bool[W, H])
    folder : path-like or None
        Of the trained networks.
    step : callable
        Called with the part that is done, 0..1, unless there are all networks already.

    Raises
    ------
    EstimatorError
        If a day is beyond what the model of the environment allows.
    """
    shared = [(shared_task(task, hosts), hosts) for task, hosts in wanted]
    missing = {
        task.key(hosts): (task, hosts) for task, hosts in shared if known_network(task, hosts, folder) is None
    }
    if not missing:
        return
    open_tasks = list(missing.values())
    step(0.0)
    done = 0
    if len(open_tasks) > 1 and all(_is_long(task) for task, _ in open_tasks) and _may_have_children():
        for number, network in _in_processes(open_tasks):
            task, hosts = open_tasks[number]
            keep_network(network, task, hosts, folder)
            done += 1
            step(done / len(open_tasks))
    for task, hosts in open_tasks:
        if known_network(task, hosts, folder) is not None:
            continue

        def part(share: float, before: int = done) -> None:
            step((before + share) / len(open_tasks))

        keep_network(learn(task, hosts, part), task, hosts, folder)
        done += 1


def _is_long(task: TrainingTask) -> bool:
    return task.outbreaks * task.epochs >= _WORTH_A_PROCESS


def _may_have_children() -> bool:
    return (os.cpu_count() or 1) > 1 and not multiprocessing.current_process().daemon


def _in_processes(tasks: Sequence[Wanted]) -> Iterator[tuple[int, Network]]:
    """Yield the networks in their order, with their numbers; fewer if a process dies."""
    from concurrent.futures.process import BrokenProcessPool

    calls = CallsAhead(learn, tasks)
    try:
        # One that was killed for its memory: the others' tasks are done here, one after the other.
        with contextlib.suppress(BrokenProcessPool):
            for number in range(len(tasks)):
                yield number, calls.result(number)
    finally:
        calls.close()
