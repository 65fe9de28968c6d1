"""Run submitted planners, policies and estimators, each in a separate process without access to the run.

The parent process simulates the run. The other process receives only the inputs of a planner, policy or
estimator. It answers with plain numbers and texts, so no submitted code runs in the parent process. The
other process is not a sandbox: submitted code can read every file that its user can read.
"""

from __future__ import annotations

import functools
import multiprocessing
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled_folder
from geo.errors import WbfMissionError, told_error
from geo.system import Closing
from geo.texts import one_line
from mission.errors import PlanningError
from mission.planners import PlannedPath, PlanningRequest
from mission.policies.decision import Decision
from mission.policies.observation import PolicyObservation, VehicleReport
from mission.policies.policy import Triggers
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Choice, ScenarioError

_MOST_BYTES = 2**30
_MOST_S = 600.0

if TYPE_CHECKING:
    Array: TypeAlias = NDArray[Any]
else:
    Array = np.ndarray


def _sent(array: Array) -> tuple[str, tuple[int, ...], bytes]:
    """Return an array as plain values: number type, shape and content."""
    return array.dtype.str, array.shape, array.tobytes()


def _received(_kind: type, plain: Any) -> Array:
    """Rebuild an array from the plain values of `_sent`; ValueError or TypeError for other values."""
    number, shape, content = plain
    if number not in ("<f8", "<f4"):
        raise ValueError(f"an array of {number[:8]!r}")
    return np.frombuffer(content, number).reshape(shape)


class Estimate(msgspec.Struct, kw_only=True):
    """An `InformationModel` as plain values that can be sent."""

    value: Array
    uncertainty: Array
    fields: tuple[str, ...]
    probabilities: dict[str, Array] | None
    loss_map: Array | None
    correlation_length: tuple[float, ...] | None


class Said(msgspec.Struct, kw_only=True):
    """Answer of the other process: an error, or the result of a call."""

    error: str = ""
    planning: bool = False
    """Whether the error is a PlanningError: a planner or policy found no path."""
    triggers: Triggers | None = None
    paths: dict[int, Array] = {}
    spacing_m: dict[int, float] = {}
    reason: str = ""
    flags: dict[str, bool] = {}
    estimate: Estimate | None = None


_encoder = msgspec.msgpack.Encoder(enc_hook=_sent)
_decoder = msgspec.msgpack.Decoder(Said, dec_hook=_received)


class Apart(Closing):
    """A planner, policy or estimator from a folder of submitted code, run in a separate process.

    `kind` is ``planner`` (also for a policy) or ``estimator``; `label` and `digest` are the object's name and
    code digest in a benchmark row; `fields` are the run's fields. Raises ResultError if no file of the folder
    defines the object, or the estimator is for other fields.
    """

    def __init__(
        self, folder: Path, kind: str, label: str, digest: str, fields: FieldSet = PAPER_FIELDS
    ) -> None:
        self.name, self.fields = label, fields
        self._private = tempfile.TemporaryDirectory()
        # Pass no other variables or caches of this process: they could reveal the simulated fields.
        home = dict.fromkeys(("HOME", "TMPDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"), self._private.name)
        kept = {key: os.environ[key] for key in ("PATH", "LANG", "LD_LIBRARY_PATH") if key in os.environ}
        found = os.pathsep.join(str(Path(one).resolve()) for one in sys.path if one)
        self._pipe, theirs = multiprocessing.Pipe()
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603 (this Python, this module)
                [sys.executable, "-c", f"from {__name__} import answer_all; answer_all()"],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=folder,
                env={**kept, **home, "PYTHONPATH": found, "NUMBA_CACHE_DIR": str(compiled_folder())},
            )
        try:
            self.said = self.call("make", str(folder), kind, label, digest, fields)
        except (WbfMissionError, _OwnCodeError) as error:
            self.close()
            raise ResultError(str(error)) from None
        except BaseException:
            self.close()
            raise

    def __deepcopy__(self, _memory: object) -> Self:
        """Return the object itself: a copy is unnecessary, as `start` and `fit` reset the process."""
        return self

    def call(self, method: str, *given: Any) -> Said:
        """Call a method in the other process, and raise its error as PlanningError or `_OwnCodeError`."""
        import cloudpickle

        # The time limit covers the whole answer: hostile code may begin an answer and never finish it.
        limit = threading.Timer(_MOST_S, self._process.kill)
        limit.start()
        try:
            self._pipe.send_bytes(cloudpickle.dumps((method, given)))
            said = _decoder.decode(self._pipe.recv_bytes(_MOST_BYTES))
        except (OSError, EOFError, msgspec.MsgspecError) as error:
            self._process.kill()  # A late answer would be taken for the answer to the next call.
            raise _LostError(
                f"{self.name}: its process ended or stopped answering ({one_line(repr(error))})"
            ) from None
        finally:
            limit.cancel()
        if said.error:
            raise (PlanningError if said.planning else _OwnCodeError)(one_line(said.error, 300))
        return said

    def close(self) -> None:
        """Terminate the other process."""
        self._process.kill()
        self._process.wait()
        self._pipe.close()
        self._private.cleanup()


class _OwnCodeError(RuntimeError):
    """An error raised by submitted code."""


class _LostError(WbfMissionError):
    """The other process ended, or does not answer."""


class PlannerApart(Apart):
    """A submitted planner, run in another process."""

    @property
    def __name__(self) -> str:
        return self.name

    def __call__(self, request: PlanningRequest) -> PlannedPath:
        """Return the path planned in the other process."""
        said = self.call("plan", _alone(request))
        return PlannedPath(said.paths[0], said.spacing_m.get(0), self.name)


class PolicyApart(Apart):
    """A submitted policy, run in another process."""

    @property
    def triggers(self) -> Triggers:
        """Triggers of the policy, as the other process reported them after the last call."""
        assert self.said.triggers is not None
        return self.said.triggers

    def start(self) -> None:
        """Reset the policy in the other process."""
        self.said = self.call("start")

    def decide(self, observation: PolicyObservation) -> Decision:
        """Return the decision made in the other process."""
        vehicles = tuple(
            replace(vehicle, request=_alone(vehicle.request), travel_cost=_sent_cost(vehicle))
            for vehicle in observation.vehicles
        )
        self.said = self.call("decide", replace(observation, vehicles=vehicles))
        return Decision(
            self.said.paths, reason=one_line(self.said.reason, 200), spacing_m=self.said.spacing_m
        )


class EstimatorApart(Apart):
    """A submitted estimator, run in another process."""

    def __getattr__(self, name: str) -> bool:
        """Return a class flag of the estimator, as reported by the other process."""
        flags = self.__dict__["said"].flags if "said" in self.__dict__ else {}
        if name not in flags:
            raise AttributeError(name)
        return bool(flags[name])

    def fit(self, grid: Any, observations: Observations | None = None) -> Self:
        """Fit the estimator in the other process."""
        self.call("fit", grid, observations)
        return self

    def partial_fit(self, observations: Observations) -> Self:
        """Add observations to the estimator in the other process."""
        self.call("partial_fit", observations)
        return self

    def advance(self, day: int) -> Self:
        """Advance the estimator in the other process to `day`."""
        self.call("advance", day)
        return self

    def prepare(self, days: Sequence[int], progress: Any = None) -> Self:  # noqa: ARG002
        """Prepare the estimator in the other process for `days`."""
        self.call("prepare", list(days))
        return self

    def predict(self) -> InformationModel:
        """Return the estimate made in the other process."""
        estimate = self.call("predict").estimate
        if estimate is None:
            raise _OwnCodeError("predict returned no InformationModel")
        return InformationModel(**msgspec.structs.asdict(estimate))


def _alone(request: PlanningRequest) -> PlanningRequest:
    """Return a copy of the request without its progress callback."""
    return replace(request, progress=_nobody)


def _nobody(_done: int, _total: int) -> None:
    """Ignore the progress of a computation."""


def _sent_cost(vehicle: VehicleReport) -> Any:
    """Return a vehicle's cost function without its progress callback, which cannot be sent."""
    cost: Any = vehicle.travel_cost
    return replace(cost, request=_alone(cost.request)) if hasattr(cost, "request") else cost


def answer_all() -> None:
    """Answer the calls of the parent process until its pipe closes."""
    pipe = Connection(os.dup(0))
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # Hide the pipe of the calls from submitted code.
    made: Any = None
    while True:
        try:
            method, given = pickle.loads(pipe.recv_bytes())  # noqa: S301 (sent by the parent process)
        except EOFError:
            return
        try:
            if method == "make":
                made = _made(*given)
            answer = _encoder.encode(_said(made, method, given))
        except (Exception, SystemExit) as error:
            planning = isinstance(error, PlanningError)
            told = str(error) if isinstance(error, WbfMissionError) else told_error(error)
            answer = _encoder.encode(Said(error=told or "failed", planning=planning))
        pipe.send_bytes(answer)


def held_by(files: Iterable[Path], kind: str, label: str, digest: str) -> Choice:
    """Return the planner, policy or estimator with this digest from one of the files.

    Raises ResultError if no file has it; the message names a file with another object of that name.
    """
    from wbf_mission.bench.digests import own_digest
    from wbf_mission.own_code import own_choice

    why = "no file of the code defines it"
    for path in files:
        try:
            choice = own_choice(f"{path}:{label}", kind)
        except ScenarioError as error:
            why = f"{why}; {error}" if path.stem in str(error) and "has no" not in str(error) else why
            continue
        if choice is None:
            continue
        if (found := own_digest(choice.made)) == digest:
            return choice
        differs = f"the digest of this file and the files beside it is {found}, not {digest}"
        why = f"{path.name} defines a {label} that differs from the one that flew the rows: {differs}"
    raise ResultError(f"{kind} {label}: {why}")


def _made(folder: str, kind: str, label: str, digest: str, fields: FieldSet) -> Any:
    choice = held_by(sorted(Path(folder).rglob("*.py")), kind, label, digest)
    if kind == "estimator":
        return make_estimator(choice.made, fields=fields)
    return choice.made if not choice.params else functools.partial(choice.made, **choice.params)


def _said(made: Any, method: str, given: tuple[Any, ...]) -> Said:
    """Call a method and return its answer as plain values."""
    if method == "plan":
        path = made(*given)
        if not isinstance(path, PlannedPath):
            raise PlanningError(f"returned a {type(path).__name__}, not a PlannedPath")
        spacing = {} if path.spacing_m is None else {0: float(path.spacing_m)}
        return Said(paths={0: _plain(path.points_m, "<f8")}, spacing_m=spacing)
    if method == "predict":
        return Said(estimate=_estimate(made.predict()))
    if method in ("make", "start", "decide"):
        answer = None if method == "make" else getattr(made, method)(*given)
        said = _about(made)
        if method == "decide":
            if not isinstance(answer, Decision):
                raise TypeError(f"answered with a {type(answer).__name__}, not a Decision")
            said.paths = {number: _plain(path, "<f8") for number, path in answer.paths.items()}
            said.spacing_m = {number: float(spacing_m) for number, spacing_m in answer.spacing_m.items()}
            said.reason = str(answer.reason)
        return said
    if method in ("fit", "partial_fit") or hasattr(made, method):
        getattr(made, method)(*given)
    return Said()


def _about(made: Any) -> Said:
    """Return the properties that the run reads from an object: triggers and class flags."""
    triggers = getattr(made, "triggers", None)
    flags = ("incremental", "states_deviation", "knows_only_seen", "unbounded")
    return Said(
        triggers=triggers if isinstance(triggers, Triggers) else None,
        flags={name: bool(getattr(made, name)) for name in flags if hasattr(made, name)},
    )


def _estimate(model: Any) -> Estimate:
    if not isinstance(model, InformationModel):
        raise TypeError(f"predict returned a {type(model).__name__}, not an InformationModel")
    loss, chances = model.expected_loss, model.probabilities
    return Estimate(
        value=_plain(model.value, "<f4"),
        uncertainty=_plain(model.uncertainty, "<f4"),
        fields=tuple(model.fields),
        probabilities=None
        if chances is None
        else {disease: _plain(chance, "<f4") for disease, chance in chances.items()},
        loss_map=None if loss is None else _plain(loss, "<f4"),
        correlation_length=model.correlation_length,
    )


def _plain(values: Any, number: str) -> Array:
    return np.ascontiguousarray(values, number)
