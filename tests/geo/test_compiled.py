"""The cache of compiled functions sees changes of what they call, and is never needed."""

import importlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numba import TypingError

from geo.compiled import _INTERNALS, _imported, _is_known_inside, compile_notices, compiled, sources_digest

OUTER = """
from geo.compiled import compile_notices, compiled
from kernels.inner import rate

@compiled
def twice(x):
    return 2.0 * rate(x)

with compile_notices(lambda name: print("compiles", name)):
    print(twice(1.0))
"""
INNER = """
from geo.compiled import compiled
from kernels.constants import FACTOR

@compiled(inline="always")
def rate(x):
    return FACTOR * x
"""


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "kernels"
    folder.mkdir()
    for name, text in (("__init__", ""), ("outer", OUTER), ("inner", INNER), ("constants", "FACTOR = 3.0\n")):
        (folder / f"{name}.py").write_text(text)
    return folder


def run(package, arguments=(), **environment):
    environment = {"NUMBA_CACHE_DIR": str(package.parent / "cache")} | environment
    done = subprocess.run(
        [sys.executable, "-m", "kernels.outer", *arguments],
        cwd=package.parent,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    *notices, result = done.stdout.split("\n")[:-1]
    return float(result), bool(notices), done.stderr


@pytest.fixture
def imported(package, monkeypatch):
    """Import the package anew in this process: its result, and whether something is compiled."""
    monkeypatch.syspath_prepend(str(package.parent))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(package.parent / "cache"))
    # Files of one size that change within a second would be taken for the same.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def forget():
        for name in [name for name in sys.modules if name.partition(".")[0] == "kernels"]:
            del sys.modules[name]
        _imported.cache_clear()
        sources_digest.cache_clear()

    def run_here():
        forget()
        told = []
        with compile_notices(told.append):
            result = importlib.import_module("kernels.outer").twice(1.0)
        return result, bool(told)

    yield run_here
    forget()


def test_of_several_processes_at_once_one_compiles_and_the_next_finds_it(package):
    with ThreadPoolExecutor(2) as pool:
        ran = list(pool.map(lambda _: run(package), range(2)))
    assert [result for result, _, _ in ran] == [6.0] * 2
    assert sum(compiles for _, compiles, _ in ran) == 1
    assert run(package)[:2] == (6.0, False)


def test_a_change_in_a_module_that_is_called_is_seen(package, imported):
    assert imported() == (6.0, True)
    assert imported() == (6.0, False)
    inner = package / "inner.py"
    inner.write_text(INNER.replace("FACTOR * x", "FACTOR * x + 1.0"))
    assert imported() == (8.0, True)
    (package / "constants.py").write_text("FACTOR = 5.0\n")
    assert imported() == (12.0, True)
    assert imported() == (12.0, False)


def test_what_cannot_be_kept_is_compiled_again(package):
    blocked = package.parent / "file"
    blocked.write_text("")
    result, compiles, errors = run(package, NUMBA_CACHE_DIR=str(blocked / "cache"))
    assert (result, compiles) == (6.0, True)
    assert errors.count("cannot be kept") == 1, errors


def test_what_cannot_be_read_is_compiled_again(package, imported):
    imported()
    for path in (package.parent / "cache").rglob("*.nb?"):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert imported() == (6.0, True)


def test_without_a_compiler_the_functions_run_as_they_are(package):
    assert run(package, NUMBA_DISABLE_JIT="1")[:2] == (6.0, False)


FACTORY = """
import sys
from geo.compiled import compile_notices, compiled
from kernels.inner import rate

@compiled
def half(x):
    return 0.5 * x

def made(name, function):
    def calls(x):
        return 1.0 + function(x)

    calls.__qualname__ = name
    return compiled(calls)

made_of = {"rate": made("calls_rate", rate), "half": made("calls_half", half)}
with compile_notices(lambda name: print("compiles", name)):
    print(sum(made_of[name](2.0) for name in sys.argv[1].split("+")))
"""


def test_functions_made_over_different_ones_are_kept_apart_and_found_again(package):
    (package / "outer.py").write_text(FACTORY)
    # Each is compiled in a process of its own, where numba gives both the same number.
    assert run(package, arguments=["rate"])[:2] == (7.0, True)
    assert run(package, arguments=["half"])[:2] == (2.0, True)
    assert run(package, arguments=["half+rate"])[:2] == (9.0, False)


def test_what_becomes_part_of_its_caller_as_machine_code_and_counts_no_references(tmp_path, monkeypatch):
    # Of what was kept numba shows no code.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    @compiled(inline="late", allocates=False)
    def total(rows):
        found = 0.0
        for row in rows:
            found += row[0]
        return found

    @compiled(allocates=False)
    def both(rows, others):
        return total(rows) + total(others[1:])

    rows, others = np.arange(6.0).reshape(3, 2), np.ones((4, 2))
    before = sys.getrefcount(rows), sys.getrefcount(others)
    assert [both(rows, others) for _ in range(3)] == [9.0] * 3
    assert (sys.getrefcount(rows), sys.getrefcount(others)) == before
    assert "NRT_" not in both.inspect_llvm(both.signatures[0])


def test_an_array_is_not_made_where_none_was_announced():
    @compiled(allocates=False)
    def zeros(count):
        return np.zeros(count)

    with pytest.raises(TypingError, match="zeros"):
        zeros(3)


WITHOUT = """
from numba.core import caching, options
del caching._CacheLocator, options.DefaultOptions._nrt
"""


def test_a_numba_that_is_unknown_inside_compiles_and_keeps_nothing(package):
    text = OUTER.replace("@compiled", "@compiled(inline='late', allocates=False)")
    (package / "outer.py").write_text(WITHOUT + text)
    result, _, errors = run(package)
    assert result == 6.0
    assert errors.count("lacks internals of the cache") == 1, errors
    assert not (package.parent / "cache").exists(), "nothing is kept for the next process"


@pytest.mark.parametrize(
    ("module", "name"), [(module, name) for module, names in _INTERNALS.items() for name in names.split()]
)
def test_a_name_that_numba_lacks_is_noticed(module, name, monkeypatch):
    *path, last = name.split(".")
    owner = importlib.import_module(module)
    for part in path:
        owner = getattr(owner, part)
    for kind in getattr(owner, "__mro__", (owner,)):
        if last in vars(kind):
            monkeypatch.delattr(kind, last)
    _is_known_inside.cache_clear()
    with pytest.warns(RuntimeWarning, match=last):
        assert not _is_known_inside()
    _is_known_inside.cache_clear()
