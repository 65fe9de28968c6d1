"""Compiles functions with numba. Cached machine code becomes invalid when a module that it uses changes.

numba's own cache checks only the file of the function, not the files of the functions that it calls. Here the
cache key is a digest of the function's module and of all modules of this project that it imports.
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
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal, TypeVar, overload

from geo.atomic import made_by_one
from geo.system import user_cache_folder

_Inline = Literal["never", "always", "late"]
_Function = TypeVar("_Function", bound=Callable[..., Any])
_IMPORT = re.compile(
    r"^(?:from[ ]+([\w.]+)[ ]+import[ ]+(\([^)]*\)|[^\n]*)|import[ ]+([\w.]+))", re.MULTILINE
)

_VERSIONS_KEPT = 8  # Versions of a module that stay cached, so that a git branch need not be recompiled

_INTERNALS = {
    "numba.core.caching": "_CacheLocator CompileResultCacheImpl._locator_classes FunctionCache._impl_class "
    "Cache._index_key Cache.cache_path Cache.load_overload Cache.save_overload",
    "numba.core.compiler_lock": "global_compiler_lock",
    "numba.core.dispatcher": "Dispatcher.compile Dispatcher.enable_caching Dispatcher.get_call_template",
    "numba.core.options": "DefaultOptions._nrt DefaultOptions.forceinline",
    "numba.core.types": "unliteral",
    "numba.core.types.functions": "BaseFunction.get_call_type BaseFunction.get_impl_key",
}
"""Internal names of numba, by module. If numba lacks any of them, compiled functions are not cached."""

_listeners: list[Callable[[str], None]] = []
_refused: list[OSError] = []


@contextmanager
def compile_notices(listener: Callable[[str], None]) -> Iterator[None]:
    """Call ``listener(name)`` before a function is compiled, since compiling takes seconds.

    An example of a name is ``sim_vehicle.motion.px4.kernel.advance``.
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
    """Compile a function at its first call (`numba.njit`) and cache the machine code for later processes.

    The cache is in the folder ``NUMBA_CACHE_DIR``, by default in the user's cache folder. If this folder
    cannot be written, or numba lacks one of `_INTERNALS`, every process compiles again and warns of it. If
    ``NUMBA_DISABLE_JIT`` is set, functions run as plain Python.

    Parameters
    ----------
    function : callable
        The function. If it is a closure, it may close over compiled functions only, and its ``__qualname__``
        must be unique, as numba's cache key contains that name.
    inline : {"never", "always", "late"}
        Whether callers inline the function. "always" inlines the Python code, which each caller then compiles
        again. "late" inlines the machine code; it suits large functions with few callers, because a call
        passes five to ten numbers per array.
    nogil : bool
        Whether the function releases the GIL.
    allocates : bool
        Whether the function makes arrays. If False, arrays are not reference-counted, which saves time, and
        compiling a function that makes an array fails.
    """
    if function is None:
        return partial(compiled, inline=inline, nogil=nogil, allocates=allocates)
    from numba import njit

    # All options are given: numba takes a missing option from the caller that compiles the function first.
    options: dict[str, Any] = {
        "inline": "always" if inline == "always" else "never",
        "nogil": nogil,
        "fastmath": False,  # Results must be equal on every processor
    }
    if _is_known_inside():
        options |= {"forceinline": inline == "late", "_nrt": allocates}
    dispatcher: Any = njit(**options)(function)
    if dispatcher is not function and _is_known_inside():
        _set_up()
        _without_literals(dispatcher)
        # numba's ``enable_caching`` would set this attribute to the cache class of numba.
        dispatcher._cache = _cache_class()(function)
        _one_process_at_a_time(dispatcher)
    return dispatcher


@cache
def _is_known_inside() -> bool:
    """Return whether numba has all `_INTERNALS`; if not, warn once."""
    numba: Any = import_module("numba")
    try:
        for module, names in _INTERNALS.items():
            attrgetter(*names.split())(import_module(module))
        attrgetter("_impl.locator", "_py_func")(_cache_class()(compiled_folder))
    except (ImportError, AttributeError) as error:
        text = f"numba {numba.__version__} lacks internals of the cache ({error}): every run compiles again"
        warnings.warn(text, RuntimeWarning, stacklevel=2)
        return False
    return True


def _one_process_at_a_time(dispatcher: Any) -> None:
    """Let one process compile a function; other processes wait, then read the machine code from the cache.

    Calls between compiled functions form no cycle, so processes cannot deadlock. numba's global lock is taken
    first and keeps out other threads of this process.
    """
    own_lock = import_module("numba.core.compiler_lock").global_compiler_lock
    compile_it = dispatcher.compile
    running: list[Any] = []

    def compile_alone(signature: Any) -> Any:
        with own_lock:
            if running:  # The function calls itself with other types
                return compile_it(signature)
            running.append(signature)
            try:
                with made_by_one(dispatcher._cache.path_of_function()):
                    return compile_it(signature)
            finally:
                running.clear()

    dispatcher.compile = compile_alone


def _without_literals(dispatcher: Any) -> None:
    """Compile a function once for all integers instead of once for each integer constant in a call."""
    types: Any = import_module("numba.core.types")
    template = dispatcher.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        plain = tuple(map(types.unliteral, args))
        return template(plain, {name: types.unliteral(kind) for name, kind in kws.items()})

    dispatcher.get_call_template = get_call_template


@cache
def _set_up() -> None:
    """Make numba cache which implementation it chooses for an operator and operand types.

    Without this cache numba tries a dozen candidates for each ``+``, which takes a third of the compile time.
    Candidates that are compiled functions depend on the caller's options and are not cached. Numba's warning
    of records that have more columns than a function uses is silenced.
    """
    functions: Any = import_module("numba.core.types.functions")
    look_up = functions.BaseFunction.get_call_type
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
    warnings.filterwarnings("ignore", r"Record\(", import_module("numba").NumbaExperimentalFeatureWarning)


@cache
def _cache_class() -> Any:
    """Return the cache class for numba, defined in a function because importing numba takes a second."""
    caching: Any = import_module("numba.core.caching")

    class Locator(caching._CacheLocator):  # type: ignore[misc]
        """Chooses the cache folder of a function by a digest of the sources that the function depends on."""

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
            # The key that numba makes holds ids of the inner functions; ids differ between processes.
            names = tuple(f"{inner.__module__}.{inner.__qualname__}" for inner in over)
            return signature, codegen.magic_tuple(), names

        def path_of_function(self) -> Path:
            with suppress(OSError):  # save_overload will warn of this error
                self._impl.locator.ensure_cache_path()
            return Path(self.cache_path, self._py_func.__qualname__)

        def load_overload(self, signature: Any, context: Any) -> Any:
            try:
                found = super().load_overload(signature, context)
            except Exception:  # The cache file is damaged: compile again
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
                        f"compiled functions cannot be kept in {self.cache_path} ({error.strerror}): every "
                        "run compiles them again; set NUMBA_CACHE_DIR to a folder that can be written",
                        RuntimeWarning,
                        stacklevel=2,
                    )
                _refused.append(error)
                self.disable()

    return KernelCache


def compiled_folder() -> Path:
    """Return the cache folder of compiled functions, which may not exist yet."""
    folder = os.environ.get("NUMBA_CACHE_DIR")
    return Path(folder) if folder else user_cache_folder("compiled")


def _closed_over(function: Callable[..., Any]) -> list[Any]:
    """Return the compiled functions that a function closes over, directly or through one another."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    over = [value for value in cells if hasattr(value, "py_func")]
    return over + [deeper for inner in over for deeper in _closed_over(inner.py_func)]


def _modified(path: Path) -> float:
    """Return the modification time of a folder, or 0 (oldest) if another process removed the folder."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


@cache
def sources_digest(file: Path) -> str:
    """Return a digest of a module and all modules of this project that it imports, directly or indirectly."""
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
    """Return the files of this project that a module imports directly."""
    root = file.parent
    while (root / "__init__.py").exists():
        root = root.parent
    paths: list[Path] = []
    for module, names, plain in _IMPORT.findall(file.read_text(encoding="utf-8")):
        base = root.joinpath(*(module or plain).split("."))
        paths += [base.with_suffix(".py"), base / "__init__.py"]
        paths += [base / f"{name}.py" for name in re.findall(r"\w+", names)]
    return tuple(path for path in paths if path.is_file())
