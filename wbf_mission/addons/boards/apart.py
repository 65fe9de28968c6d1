"""Own code in a process of its own, which has neither the run nor its files.

A run is flown here. The other process is sent what a planner, policy or estimator is given, and nothing else;
it answers with plain numbers and texts, so that nothing of its making runs here. It is no sandbox: code may
read what its user may read.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import selectors
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from geo.closing import Closing
from geo.compiled import compiled_folder
from geo.errors import WbfMissionError, told_error
from geo.texts import one_line
from mission.errors import PlanningError
from mission.planners import PlannedPath, PlanningRequest
from mission.policies.decision import Decision
from mission.policies.observation import PolicyObservation, VehicleReport
from mission.policies.policy import Triggers
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Choice, ScenarioError

_SIZE = struct.Struct("<Q")
_MOST_BYTES = 2**30
_MOST_S = 600.0


class Array(msgspec.Struct, array_like=True):
    """An array of numbers as plain values."""

    kind: str
    shape: tuple[int, ...]
    content: bytes

    @classmethod
    def of(cls, values: Any, kind: str = "<f8") -> Self:
        """Return the plain values of an array."""
        array = np.ascontiguousarray(values, kind)
        return cls(kind, array.shape, array.tobytes())

    def array(self) -> NDArray[Any]:
        """Return the array; ValueError if its values are not as many as it says."""
        if self.kind not in ("<f8", "<f4"):
            raise ValueError(f"an array of {self.kind[:8]!r}")
        return np.frombuffer(self.content, self.kind).reshape(self.shape)


class Said(msgspec.Struct, kw_only=True):
    """An answer of the other process: an error, or what a call gave."""

    error: str = ""
    planning: bool = False
    """Whether the error is a PlanningError, as a planner or policy says that there is no path."""
    triggers: tuple[float | None, int | None, bool, float] | None = None
    paths: dict[int, Array] = {}
    spacing_m: dict[int, float] = {}
    reason: str = ""
    fields: tuple[str, ...] = ()
    flags: dict[str, bool] = {}
    value: Array | None = None
    uncertainty: Array | None = None
    probabilities: dict[str, Array] | None = None
    loss: Array | None = None
    correlation_length: tuple[float, ...] | None = None


class Apart(Closing):
    """A planner, policy or estimator of a folder of code, in a process of its own.

    Parameters
    ----------
    kind : str
        ``planner`` (or a policy), or ``estimator``.
    label, digest : str
        Its name with parameters, and its digest, as a row has them.

    ResultError if no file of the folder holds it.
    """

    def __init__(self, folder: Path, kind: str, label: str, digest: str) -> None:
        self.name = label
        self._private = tempfile.TemporaryDirectory()
        # Only what Python needs: no variable and no cache of this process, which may lead to environments.
        home = dict.fromkeys(("HOME", "TMPDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"), self._private.name)
        kept = {key: os.environ[key] for key in ("PATH", "LANG", "LD_LIBRARY_PATH") if key in os.environ}
        found = os.pathsep.join(str(Path(one).resolve()) for one in sys.path if one)
        self._process = subprocess.Popen(  # noqa: S603 (this Python, this module)
            [sys.executable, "-c", f"from {__name__} import answer_all; answer_all()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=folder,
            env={**kept, **home, "PYTHONPATH": found, "NUMBA_CACHE_DIR": str(compiled_folder())},
        )
        try:
            self.said = self.call("make", str(folder), kind, label, digest)
        except (WbfMissionError, _OwnCodeError) as error:
            self.close()
            raise ResultError(str(error)) from None
        except BaseException:
            self.close()
            raise

    def __deepcopy__(self, _memory: object) -> Self:
        """No copy is needed: `start` and `fit` reset the process."""
        return self

    def call(self, method: str, *given: Any) -> Said:
        """Have a method called; PlanningError or WbfMissionError with what it says, if it fails."""
        import cloudpickle

        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            _write(self._process.stdin, cloudpickle.dumps((method, given)))
            said = msgspec.msgpack.decode(_read(self._process.stdout, _MOST_S), type=Said)
        except (OSError, EOFError, TimeoutError, msgspec.MsgspecError) as error:
            self._process.kill()  # an answer that came late would be taken for that of the next call
            raise _LostError(
                f"{self.name}: its process ended or answers no more ({one_line(repr(error))})"
            ) from None
        if said.error:
            raise (PlanningError if said.planning else _OwnCodeError)(one_line(said.error, 300))
        return said

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):  # it ended while it was being written to
                    pipe.close()
        self._private.cleanup()


class _OwnCodeError(RuntimeError):
    """An error of own code."""


class _LostError(WbfMissionError):
    """A process that ended, or answers no more."""


class PlannerApart(Apart):
    """A planner in a process of its own."""

    @property
    def __name__(self) -> str:
        return self.name

    def __call__(self, request: PlanningRequest) -> PlannedPath:
        """Plan as it does."""
        said = self.call("plan", _alone(request))
        return PlannedPath(said.paths[0].array(), said.spacing_m.get(0), self.name)


class PolicyApart(Apart):
    """A policy in a process of its own."""

    @property
    def triggers(self) -> Triggers:
        """When it wanted to be asked when it was last called."""
        assert self.said.triggers is not None
        return Triggers(*self.said.triggers)

    def start(self) -> None:
        """Forget everything."""
        self.said = self.call("start")

    def decide(self, observation: PolicyObservation) -> Decision:
        """Answer as it does."""
        vehicles = tuple(
            replace(one, request=_alone(one.request), travel_cost=_sent_cost(one))
            for one in observation.vehicles
        )
        self.said = self.call("decide", replace(observation, vehicles=vehicles))
        paths = {number: path.array() for number, path in self.said.paths.items()}
        return Decision(paths, reason=one_line(self.said.reason, 200), spacing_m=self.said.spacing_m)


class EstimatorApart(Apart):
    """An estimator in a process of its own."""

    fields: FieldSet

    def __getattr__(self, name: str) -> bool:
        """Give what the class of the estimator says of itself."""
        flags = self.__dict__["said"].flags if "said" in self.__dict__ else {}
        if name not in flags:
            raise AttributeError(name)
        return bool(flags[name])

    def fit(self, grid: Any, observations: Observations | None = None) -> Self:
        """Learn as it does."""
        self.call("fit", grid, observations)
        return self

    def partial_fit(self, observations: Observations) -> Self:
        """Learn more as it does."""
        self.call("partial_fit", observations)
        return self

    def advance(self, day: int) -> Self:
        """Go on to a day as it does."""
        self.call("advance", day)
        return self

    def prepare(self, days: Sequence[int], progress: Any = None) -> Self:  # noqa: ARG002
        """Prepare as it does."""
        self.call("prepare", list(days))
        return self

    def predict(self) -> InformationModel:
        """Return what it believes."""
        said = self.call("predict")
        if said.value is None or said.uncertainty is None:
            raise _OwnCodeError("predict returned no InformationModel")
        chances = said.probabilities
        return InformationModel(
            said.value.array(),
            said.uncertainty.array(),
            fields=said.fields,
            probabilities=None if chances is None else {key: one.array() for key, one in chances.items()},
            loss_map=None if said.loss is None else said.loss.array(),
            correlation_length=said.correlation_length,
        )


def _alone(request: PlanningRequest) -> PlanningRequest:
    """Return a request that leads to nobody who is told of its progress."""
    return replace(request, progress=_nobody)


def _nobody(_done: int, _total: int) -> None:
    """Tell nobody."""


def _sent_cost(vehicle: VehicleReport) -> Any:
    """Return what prices a vehicle's paths, without what its request leads to."""
    cost: Any = vehicle.travel_cost
    return replace(cost, request=_alone(cost.request)) if hasattr(cost, "request") else cost


def _write(pipe: IO[bytes], content: bytes) -> None:
    pipe.write(_SIZE.pack(len(content)) + content)
    pipe.flush()


def _read(pipe: IO[bytes], most_s: float | None = None) -> bytes:
    """Read a message; EOFError at its end, TimeoutError if a part of it takes longer than that."""
    (size,) = _SIZE.unpack(_exactly(pipe, _SIZE.size, most_s))
    if size > _MOST_BYTES:
        raise EOFError("a message too large")
    return _exactly(pipe, size, most_s)


def _exactly(pipe: IO[bytes], size: int, most_s: float | None) -> bytes:
    parts, descriptor = bytearray(), pipe.fileno()
    with selectors.DefaultSelector() as selector:
        selector.register(descriptor, selectors.EVENT_READ)
        while len(parts) < size:
            if not selector.select(most_s):
                raise TimeoutError(f"no answer in {most_s:g} s")
            part = os.read(descriptor, min(2**20, size - len(parts)))
            if not part:
                raise EOFError("its end")
            parts += part
    return bytes(parts)


def answer_all() -> None:
    """Answer the calls of the process that started this one, until it ends."""
    # What own code prints does not get among the answers.
    answers = os.fdopen(os.dup(1), "wb")
    calls = os.fdopen(os.dup(0), "rb", buffering=0)
    silent = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1):
        os.dup2(silent, number)
    made: Any = None
    while True:
        try:
            method, given = pickle.loads(_read(calls))  # noqa: S301 (of the process that started this one)
        except EOFError:
            return
        try:
            if method == "make":
                made = _made(*given)
            _write(answers, msgspec.msgpack.encode(_said(made, method, given)))
        except (Exception, SystemExit) as error:
            planning = isinstance(error, PlanningError)
            told = str(error) if isinstance(error, WbfMissionError) else told_error(error)
            _write(answers, msgspec.msgpack.encode(Said(error=told or "failed", planning=planning)))


def held_by(files: Iterable[Path], kind: str, label: str, digest: str) -> Choice:
    """Return the planner, policy or estimator of a digest that one of these files holds.

    ResultError if none does, with the file that holds another of its name.
    """
    from wbf_mission.bench.digests import own_digest
    from wbf_mission.own_code import own_choice

    why = "no file of its code has it"
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
        differs = f"its digest, with the files beside it, is {found}, not {digest}"
        why = f"{path.name} has another {label} than the one that flew the rows: {differs}"
    raise ResultError(f"{kind} {label}: {why}")


def _made(folder: str, kind: str, label: str, digest: str) -> Any:
    choice = held_by(sorted(Path(folder).rglob("*.py")), kind, label, digest)
    return choice.made if not choice.params else _Planner(choice.made, choice.params)


class _Planner:
    """A planner with its parameters."""

    def __init__(self, made: Any, parameters: dict[str, Any]) -> None:
        self._made, self._parameters = made, parameters

    def __call__(self, request: PlanningRequest) -> PlannedPath:
        path: PlannedPath = self._made(request, **self._parameters)
        return path


def _said(made: Any, method: str, given: tuple[Any, ...]) -> Said:
    """Call a method, and return its answer as plain values."""
    if method == "plan":
        path = made(*given)
        if not isinstance(path, PlannedPath):
            raise PlanningError(f"returned a {type(path).__name__}, not a PlannedPath")
        spacing = {} if path.spacing_m is None else {0: float(path.spacing_m)}
        return Said(paths={0: Array.of(path.points_m)}, spacing_m=spacing)
    if method in ("make", "start", "decide"):
        answer = None if method == "make" else getattr(made, method)(*given)
        return _answer(made, answer) if method == "decide" else _about(made)
    if method == "predict":
        return _believed(made.predict())
    if method in ("fit", "partial_fit") or hasattr(made, method):
        getattr(made, method)(*given)
    return Said()


def _about(made: Any) -> Said:
    """Return what an object says of itself."""
    triggers = getattr(made, "triggers", None)
    said = Said(fields=tuple(getattr(getattr(made, "fields", None), "names", ())))
    if isinstance(triggers, Triggers):
        said.triggers = (triggers.period_s, triggers.observations, triggers.waypoints, triggers.least_s)
    for name in ("incremental", "states_deviation", "knows_only_seen", "unbounded"):
        if hasattr(made, name):
            said.flags[name] = bool(getattr(made, name))
    return said


def _answer(made: Any, answer: Any) -> Said:
    if not isinstance(answer, Decision):
        raise TypeError(f"answered with a {type(answer).__name__}, not a Decision")
    said = _about(made)
    said.paths = {number: Array.of(path) for number, path in answer.paths.items()}
    said.spacing_m = {number: float(one) for number, one in answer.spacing_m.items()}
    said.reason = str(answer.reason)
    return said


def _believed(model: Any) -> Said:
    if not isinstance(model, InformationModel):
        raise TypeError(f"predict returned a {type(model).__name__}, not an InformationModel")
    loss = model.loss_map() if callable(model.loss_map) else model.loss_map
    chances = None if model.probabilities is None else dict(model.probabilities.items())
    return Said(
        fields=tuple(model.fields),
        value=Array.of(model.value, "<f4"),
        uncertainty=Array.of(model.uncertainty, "<f4"),
        probabilities=None
        if chances is None
        else {key: Array.of(one, "<f4") for key, one in chances.items()},
        loss=None if loss is None else Array.of(loss, "<f4"),
        correlation_length=model.correlation_length,
    )
