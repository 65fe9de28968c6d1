"""Planners, policies and estimators from a user's file, such as ``my_policy.py:MyPolicy:speed=3``.

Code can be named only on the command line. Scenario files, specifications and results are not trusted, so
they cannot name code.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import importlib
import importlib.util
import inspect
import itertools
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from geo.errors import told_error
from geo.named import ParameterError, format_named, parse_named
from wbf_mission.scenario import Choice, ScenarioError

_PREFIX = "own_"
_OWN = re.compile(r"(?P<file>.+\.py):(?P<name>[^\W\d]\w*)(?::(?P<parameters>.*))?", re.DOTALL)


def own_choice(text: str, what: str) -> Choice | None:
    """Return the planner, policy or estimator that a user's file defines, or None if `text` names no file.

    `text` is ``FILE.py:NAME`` or ``FILE.py:NAME:key=value,...``. NAME is a planner (a function), an object
    or a class, which is called with the parameters. `what` is ``planner``, ``policy`` or ``estimator``.

    ScenarioError if NAME is missing, the file cannot be run or has no such name, or the class does not take
    the parameters.
    """
    found = _OWN.fullmatch(text.strip())
    if found is None:
        if text.strip().endswith((".py", ".py:")):
            raise ScenarioError(f"{what}: {text} names a file, but no {what} in it; give FILE.py:NAME")
        return None
    path, name, given = Path(found["file"]), found["name"], found["parameters"]
    try:
        parameters = parse_named(f"{name}:{given}")[1] if given else {}
    except ParameterError as error:
        raise ScenarioError(f"{what}: {error}") from None
    module = _run(path, what)
    made = getattr(module, name, None)
    if made is None:
        own = [
            key for key, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__
        ]
        raise ScenarioError(f"{what}: {path} defines no {name}; it defines {', '.join(own) or 'nothing'}")
    if what == "planner" and callable(made) and not inspect.isclass(made):
        return Choice(name, dict(parameters), made)
    if callable(made):
        try:
            with contextlib.redirect_stdout(sys.stderr):
                made = made(**parameters)
        except (Exception, SystemExit) as error:
            raise ScenarioError(f"{what}: {path}: {name} cannot be made: {told_error(error)}") from None
    elif parameters:
        raise ScenarioError(f"{what}: {path}: {name} is an object; name its class to set parameters")
    return Choice(format_named(name, parameters), {}, made)


def _run(path: Path, what: str) -> ModuleType:
    if not path.is_file():
        raise ScenarioError(f"{what}: there is no file {path}; give FILE.py:NAME")
    name = f"{_PREFIX}{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:12]}_{path.stem}"
    if name in sys.modules:
        return sys.modules[name]
    _find_neighbours(path, what)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ScenarioError(f"{what}: {path} cannot be loaded as Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        with contextlib.redirect_stdout(sys.stderr):
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise ScenarioError(f"{what}: {path} cannot be run: {told_error(error)}") from None
    import cloudpickle

    # Other processes cannot import the module, so its code is pickled by value.
    cloudpickle.register_pickle_by_value(module)
    return module


def below_own_code(path: str) -> str:
    """Return a path relative to the folder of user code that contains it; return other paths unchanged."""
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
        sys.path.append(folder)  # at the end of the path, so that no file in the folder hides a library
    importlib.invalidate_caches()
    for name, beside in neighbours(file).items():
        known = sys.modules.get(name)
        spec = importlib.util.find_spec(name) if known is None else None
        found = getattr(known, "__file__", None) if spec is None else spec.origin
        if found is None or Path(found).resolve() != beside:
            other = found or "another"
            msg = f"{what}: {path} imports its neighbour {name}, but {other} has the same name; rename yours"
            raise ScenarioError(msg)


_LONGEST = 200
_MOST_MATCHES = 1000


def neighbours(file: Path) -> dict[str, Path]:
    """Return the modules in the folder of `file` that `file` imports, by name."""
    found: dict[str, Path] = {}
    for node in ast.walk(_tree(file)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names = [node.module]
        for name in {module.partition(".")[0] for module in names}:
            for path in (file.parent / f"{name}.py", file.parent / name / "__init__.py"):
                if path.is_file() and path != file:
                    found.setdefault(name, path)
    return found


def files_beside(file: Path) -> list[Path]:
    """Return the files that a user's code file uses from its folder, sorted.

    These are modules that the code imports, directly or indirectly (of a package, all modules), and data
    files. A data file counts if a string in the code is its name, or a matching pattern such as
    ``weights-*.npz``. Data files are searched in the code's folder and in subfolders that the code names.
    """
    code, waiting = {file}, [file]
    while waiting:
        for path in neighbours(waiting.pop()).values():
            new = set(path.parent.rglob("*.py")) if path.name == "__init__.py" else {path}
            waiting += new - code
            code |= new
    found = set(code)
    for path in code:
        found.update(_named(path))
    return sorted(found - {file})


def digest_beside(file: Path) -> str:
    """Return a digest of `files_beside`; empty if there are none."""
    digest = hashlib.sha256()
    files = files_beside(file)
    for path in files:
        content = path.read_bytes()
        digest.update(f"{path.relative_to(file.parent).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest() if files else ""


def _named(file: Path) -> Iterator[Path]:
    texts = {
        node.value
        for node in ast.walk(_tree(file))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and _may_name(node.value)
    }
    folders = [file.parent, *(file.parent / text for text in texts if (file.parent / text).is_dir())]
    for folder in folders:
        for text in texts:
            if not set("*?").isdisjoint(text):
                matches = itertools.islice(folder.glob(text), _MOST_MATCHES)
                yield from (path for path in matches if path.is_file())
            elif (folder / text).is_file():
                yield folder / text


def _may_name(text: str) -> bool:
    """Return whether `text` can be a relative file name, or a pattern of file names."""
    parts = text.split("/")
    plain = text.isprintable() and 0 < len(text.encode()) <= _LONGEST and any(map(str.isalnum, text))
    pattern = not set("*?").isdisjoint(text)
    return plain and not {"", ".", ".."} & set(parts) and "**" not in text and not (pattern and " " in text)


def _tree(file: Path) -> ast.AST:
    """Return the syntax tree of a file, or an empty tree if the file is not valid Python."""
    try:
        return ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return ast.Module([], [])
