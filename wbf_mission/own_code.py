"""Planners, policies and estimators from a user's file, such as ``my_policy.py:MyPolicy:speed=3``.

Code can be named only on the command line. Scenario files, specifications and results are not trusted, so
they cannot name code.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import re
import sys
import traceback
from pathlib import Path
from types import ModuleType

from geo.named import ParameterError, format_named, parse_named
from geo.texts import one_line
from wbf_mission.scenario import Choice, ScenarioError
from wbf_mission.scenario.beside import neighbours

_PREFIX = "own_"
_OWN = re.compile(r"(?P<file>.+\.py):(?P<name>[^\W\d]\w*)(?::(?P<parameters>.*))?", re.DOTALL)


def own_choice(text: str, what: str) -> Choice | None:
    """Return the planner, policy or estimator of a user's file; None if `text` names no file.

    `text` is ``FILE.py:NAME`` or ``FILE.py:NAME:key=value,...``. NAME is a planner (a function) or a class,
    which is called with the parameters. `what` is ``planner``, ``policy`` or ``estimator``.

    ScenarioError if the file cannot be run or has no such name, or the class does not take the parameters.
    """
    found = _OWN.fullmatch(text.strip())
    if found is None:
        return None
    path, name, given = Path(found["file"]), found["name"], found["parameters"]
    try:
        parameters = parse_named(f"{name}:{given}")[1] if given else {}
    except ParameterError as error:
        msg = f"{what}: {error}"
        raise ScenarioError(msg) from None
    module = _run(path, what)
    made = getattr(module, name, None)
    if made is None:
        own = [
            key for key, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__
        ]
        msg = f"{what}: {path} has no {name}; it has {', '.join(own) or 'nothing of its own'}"
        raise ScenarioError(msg)
    if what == "planner" and inspect.isfunction(made):
        return Choice(name, dict(parameters), made)
    if callable(made):
        try:
            made = made(**parameters)
        except (Exception, SystemExit) as error:
            msg = f"{what}: {path}: {name} cannot be made: {_told(error, path)}"
            raise ScenarioError(msg) from None
    return Choice(format_named(name, parameters), {}, made)


def _run(path: Path, what: str) -> ModuleType:
    if not path.is_file():
        msg = f"{what}: there is no file {path}; give FILE.py:NAME"
        raise ScenarioError(msg)
    name = f"{_PREFIX}{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:12]}_{path.stem}"
    if name in sys.modules:
        return sys.modules[name]
    _find_neighbours(path, what)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        msg = f"{what}: {path} cannot be loaded as Python"
        raise ScenarioError(msg)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        msg = f"{what}: {path} cannot be run: {_told(error, path)}"
        raise ScenarioError(msg) from None
    import cloudpickle

    # Other processes cannot import the module, so its code is pickled by value.
    cloudpickle.register_pickle_by_value(module)
    return module


def below_own_code(path: str) -> str:
    """Return a path in the user's code folder relative to that folder, which may move; others unchanged."""
    files = (
        getattr(module, "__file__", None)
        for name, module in list(sys.modules.items())
        if name.startswith(_PREFIX)
    )
    folders = {
        parent
        for file in files
        if file
        for parent in (Path(file).absolute().parent, Path(file).resolve().parent)
    }
    inside = [folder for folder in folders if Path(path).is_relative_to(folder)]
    return str(Path(path).relative_to(max(inside, key=lambda folder: len(folder.parts)))) if inside else path


def _find_neighbours(path: Path, what: str) -> None:
    """Let a file import the modules in its folder; ScenarioError if a module's name is already taken."""
    file = path.resolve()
    if (folder := str(file.parent)) not in sys.path:
        sys.path.append(folder)  # last, so that no file in the folder hides a library
    importlib.invalidate_caches()
    for name, beside in neighbours(file).items():
        known = sys.modules.get(name)
        spec = importlib.util.find_spec(name) if known is None else None
        found = getattr(known, "__file__", None) if spec is None else spec.origin
        if found is None or Path(found).resolve() != beside:
            other = found or "another"
            msg = f"{what}: {path} imports {name} beside it, but there is {other}, too; rename yours"
            raise ScenarioError(msg)


def _told(error: BaseException, path: Path) -> str:
    """Return an error in one line, with its line number in `path`."""
    text = one_line(str(error))
    file = path.resolve()
    trace = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in trace if Path(frame.filename).resolve() == file]
    if isinstance(error, SyntaxError):
        lines = [error.lineno] if error.lineno else []
        text = error.msg
        if error.filename and Path(error.filename).resolve() != file:
            text = f"{Path(error.filename).name}: {text}"
    where = f" (line {lines[-1]})" if lines else ""
    return f"{type(error).__name__}: {text}{where}"
