"""Compiled functions (numba) whose cache sees a change in any module that they use.

numba keeps compiled code while a function's own file is unchanged, whatever happens to the files of functions
that it calls. Here the key is a digest of the function's module and of all modules of the same distribution
that it imports, directly or not.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, TypeVar, overload

from geo.user_cache import made_by_one, user_cache_folder

_Inline = Literal["never", "always", "late"]
_Function = TypeVar("_Function", bound=Callable[..., Any])
_IMPORT = re.compile(
    r"^(?:from[ ]+([\w.]+)[ ]+import[ ]+(\([^)]*\)|[^\n]*)|import[ ]+([\w.]+))", re.MULTILINE
)

_VERSIONS_KEPT = 8  # Of a module: branches that are worked on by turns

_listeners: list[Callable[[str], None]] = []
_refused: list[OSError] = []


@contextmanager
def compile_notices(listener: Callable[[str], None]) -> Iterator[None]:
    """Call `listener` before each function that has to be compiled, which takes seconds.

    It gets a name such as ``sim_vehicle.motion.px4.kernel.advance``.
    """
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


@overload
def compiled(function: _Function) -> _Function: ...
@overload
def compiled(
    *, inline: _Inline = "never", nogil: bool = False, allocates: bool = True
) -> Callable[[_Function], _Function]: ...
def compiled(
    function: Any = None,
    *,
    inline: _Inline = "never",
    nogil: bool = False,
    allocates: bool = True,
) -> Any:
    """Compile a function at its first call (`numba.njit`), and keep the result for the next process.

    The cache is in the user's cache folder, or in ``NUMBA_CACHE_DIR``. If it cannot be written, there is one
    warning, and every process compiles for itself. With ``NUMBA_DISABLE_JIT`` functions stay Python.

    Parameters
    ----------
    function : callable
        A function defined inside another one may close over compiled functions only, and needs a
        ``__qualname__`` of its own, by which numba keeps the code of several such functions apart.
    inline : {"never", "always", "late"}
        Whether it becomes part of its callers: "always" as Python, compiled anew in each; "late" as machine
        code, for large functions called at few places (a call hands over five to ten numbers an array).
    nogil : bool
        Whether other threads run meanwhile.
    allocates : bool
        Whether it makes arrays. A function that makes none skips counting the users of its arrays, an atomic
        operation each; compiling fails if it makes one all the same.
    """
    if function is None:
        return partial(compiled, inline=inline, nogil=nogil, allocates=allocates)
    from numba import njit

    # All are given: an option left out is that of the caller for which the function is first compiled.
    options: dict[str, Any] = {
        "inline": "always" if inline == "always" else "never",
        "forceinline": inline == "late",
        "nogil": nogil,
        "fastmath": False,  # The same sums on every processor
        "_nrt": allocates,
    }
    dispatcher: Any = njit(**options)(function)
    if dispatcher is not function:
        _remember_operators()
        _take_longer_records()
        _without_literals(dispatcher)
        # As numba's ``enable_caching`` does it.
        dispatcher._cache = _cache_class()(function)
        _one_process_at_a_time(dispatcher)
    return dispatcher


def _one_process_at_a_time(dispatcher: Any) -> None:
    """Let one process compile a function, while others that need it wait, and find it in the cache then.

    No two processes wait for each other, as calls have no circle; numba's own lock, taken first, orders the
    threads of a process.
    """
    own_lock = import_module("numba.core.compiler_lock").global_compiler_lock
    compile_it = dispatcher.compile
    running: list[Any] = []

    def compile_alone(signature: Any) -> Any:
        with own_lock:
            if running:  # it calls itself with other types
                return compile_it(signature)
            running.append(signature)
            try:
                with made_by_one(dispatcher._cache.path_of_function()):
                    return compile_it(signature)
            finally:
                running.clear()

    dispatcher.compile = compile_alone


def _without_literals(dispatcher: Any) -> None:
    """Compile a function once for all integers, in place of once for each constant argument."""
    types: Any = import_module("numba.core.types")
    template = dispatcher.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        plain = tuple(map(types.unliteral, args))
        return template(plain, {name: types.unliteral(kind) for name, kind in kws.items()})

    dispatcher.get_call_template = get_call_template


@cache
def _take_longer_records() -> None:
    """Silence numba where a function is given a record with further columns."""
    numba: Any = import_module("numba")
    warnings.filterwarnings("ignore", r"Record\(", numba.NumbaExperimentalFeatureWarning)


@cache
def _remember_operators() -> None:
    """Have numba resolve an operator or built-in function once for the same argument types.

    It would try a dozen candidates anew for each ``+`` of a function: a third of the time of compiling.
    Candidates that are compiled themselves depend on the caller's options and are not remembered. A numba
    with another way of resolving is left alone.
    """
    functions: Any = import_module("numba.core.types.functions")
    look_up = getattr(functions.BaseFunction, "get_call_type", None)
    if look_up is None or not hasattr(functions.BaseFunction, "get_impl_key"):
        return
    known: dict[Any, Any] = {}

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        key = self, context, tuple(args)
        if not kws and key in known:
            return known[key]
        signature = look_up(self, context, args, kws)
        if signature is not None and not kws and self.get_impl_key(signature) is self.typing_key:
            known[key] = signature
        return signature

    functions.BaseFunction.get_call_type = get_call_type


@cache
def _cache_class() -> Any:
    """Return the class of a function's cache; defined here because importing numba takes a second."""
    caching: Any = import_module("numba.core.caching")

    class Locator(caching._CacheLocator):  # type: ignore[misc]
        """The cache folder of a function, and the digest of its sources."""

        def __init__(self, function: Callable[..., Any], file: str) -> None:
            self._module = function.__module__
            self._line = function.__code__.co_firstlineno
            over = [inner.py_func.__code__.co_filename for inner in _closed_over(function)]
            digests = sorted({sources_digest(Path(source).resolve()) for source in (file, *over)})
            self._digest = hashlib.sha256("".join(digests).encode()).hexdigest()
            self._folder = compiled_folder() / f"{self._module}-{self._digest[:16]}"

        @classmethod
        def from_function(cls, function: Callable[..., Any], file: str) -> Locator:
            return cls(function, file)

        def get_cache_path(self) -> str:
            return str(self._folder)

        def ensure_cache_path(self) -> None:
            if not self._folder.exists():
                self._folder.mkdir(parents=True)
                versions = sorted(self._folder.parent.glob(f"{self._module}-*"), key=_modified)
                for old in versions[:-_VERSIONS_KEPT]:
                    shutil.rmtree(old, ignore_errors=True)

        def get_source_stamp(self) -> str:
            return self._digest

        def get_disambiguator(self) -> str:
            return str(self._line)

    class Implementation(caching.CompileResultCacheImpl):  # type: ignore[misc]
        _locator_classes = (Locator,)

    class KernelCache(caching.FunctionCache):  # type: ignore[misc]
        _impl_class = Implementation

        def _index_key(self, signature: Any, codegen: Any) -> Any:
            over = _closed_over(self._py_func)
            if not over:
                return super()._index_key(signature, codegen)
            # numba's own key has a number of each inner function, which is another in each process.
            names = tuple(f"{inner.__module__}.{inner.__qualname__}" for inner in over)
            return signature, codegen.magic_tuple(), names

        def path_of_function(self) -> Path:
            with suppress(OSError):  # save_overload warns of it
                self._impl.locator.ensure_cache_path()
            return Path(self._cache_path, self._py_func.__qualname__)

        def load_overload(self, signature: Any, context: Any) -> Any:
            try:
                found = super().load_overload(signature, context)
            except Exception:  # a damaged file: compiled again
                found = None
                with suppress(OSError):
                    self.flush()
            if found is None:
                name = f"{self._py_func.__module__}.{self._py_func.__qualname__}"
                for listener in tuple(_listeners):
                    listener(name)
            return found

        def save_overload(self, signature: Any, data: Any) -> None:
            try:
                super().save_overload(signature, data)
            except OSError as error:
                if not _refused:
                    warnings.warn(
                        f"compiled functions cannot be kept in {self._cache_path} ({error.strerror}): every "
                        "run compiles them again; set NUMBA_CACHE_DIR to a folder that can be written",
                        RuntimeWarning,
                        stacklevel=2,
                    )
                _refused.append(error)
                self.disable()

    return KernelCache


def compiled_folder() -> Path:
    """Return the folder in which compiled functions are kept; it may not exist yet."""
    folder = os.environ.get("NUMBA_CACHE_DIR")
    return Path(folder) if folder else user_cache_folder("compiled")


def _closed_over(function: Callable[..., Any]) -> list[Any]:
    """Return the compiled functions in a function's closure, and in theirs."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    over = [value for value in cells if hasattr(value, "py_func")]
    return over + [deeper for inner in over for deeper in _closed_over(inner.py_func)]


def _modified(path: Path) -> float:
    """Return the time of the last change; a folder that was removed meanwhile counts as oldest."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


@cache
def sources_digest(file: Path) -> str:
    """Return a digest of a module and all modules of its distribution that its top level leads to."""
    found: dict[Path, bytes] = {}
    left = [file]
    while left:
        path = left.pop()
        if path not in found:
            found[path] = path.read_bytes()
            left += _imported(path)
    digest = hashlib.sha256()
    for path in sorted(found):
        digest.update(hashlib.sha256(found[path]).digest())
    return digest.hexdigest()


@cache
def _imported(file: Path) -> tuple[Path, ...]:
    """Return the files that a module imports from packages beside its own."""
    root = file.parent
    while (root / "__init__.py").exists():
        root = root.parent
    paths: list[Path] = []
    for module, names, plain in _IMPORT.findall(file.read_text(encoding="utf-8")):
        base = root.joinpath(*(module or plain).split("."))
        paths += [base.with_suffix(".py"), base / "__init__.py"]
        paths += [base / f"{name}.py" for name in re.findall(r"\w+", names)]
    return tuple(path for path in paths if path.is_file())
