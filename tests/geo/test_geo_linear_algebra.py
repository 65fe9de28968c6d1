"""Sums in the order of the index; nothing on the way to a recorded result leaves them to the processor."""

import ast
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from geo import linear_algebra as la
from geo.errors import PACKAGES

ROOT = Path(__file__).parents[2]
SIZES = st.integers(1, 70)


def plain_product(a, b):
    out = np.zeros((len(a), b.shape[1]), a.dtype)
    for k in range(len(b)):
        out += a[:, k, None] * b[k]
    return out


def positive(n, seed, margin=1.0):
    around = np.random.default_rng(seed).standard_normal((n, n + 3))
    return plain_product(around, np.ascontiguousarray(around.T)) + margin * np.eye(n)


def plain_factor(matrix):
    factor = np.zeros_like(matrix)
    for j in range(len(matrix)):
        column = matrix[j:, j].copy()
        for k in range(j):
            column -= factor[j, k] * factor[j:, k]
        factor[j, j] = math.sqrt(column[0])
        factor[j + 1 :, j] = column[1:] * (1.0 / factor[j, j])
    return factor


@pytest.mark.kernel
@given(SIZES, SIZES, st.integers(1, 9), st.sampled_from([np.float32, np.float64]), st.integers(0, 99))
def test_a_product_is_the_plain_sum(n, depth, m, kind, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((n, depth)).astype(kind), rng.standard_normal((depth, m)).astype(kind)
    whole = la.product(a, b)
    assert whole.dtype == kind
    assert np.array_equal(whole, plain_product(a, b))
    # Of Fortran's order, of views, of vectors, in parts, and in memory that is given.
    assert np.array_equal(la.product(np.asfortranarray(a), np.asfortranarray(b)), whole)
    assert np.array_equal(la.product(np.repeat(a, 2, axis=1)[:, ::2], b[::-1][::-1]), whole)
    assert np.array_equal(la.product(a[n // 2], b), whole[n // 2])
    assert np.array_equal(la.product(a, b[:, 0]), whole[:, 0])
    assert la.product(a[0], b[:, 0]) == whole[0, 0]
    assert np.array_equal(np.concatenate([la.product(a[:3], b), la.product(a[3:], b)]), whole)
    assert np.array_equal(la.product(a[None], b), whole[None])
    given_memory = np.full_like(whole, np.nan)
    assert la.product(a, b, out=given_memory) is given_memory
    assert np.array_equal(given_memory, whole)


def test_a_wide_product_is_the_plain_sum():
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((7, 9)), rng.standard_normal((9, 1100))
    assert np.array_equal(la.product(a, b), plain_product(a, b))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_without_compiled_code_the_sum_is_the_same(kind, monkeypatch):
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((30, 40)).astype(kind), rng.standard_normal((40, 30)).astype(kind)
    la._kernels()
    compiled = la.product(a, b)
    monkeypatch.delitem(sys.modules, "geo.linear_algebra_kernels")
    monkeypatch.setattr(la, "_kernels", None)
    assert np.array_equal(la.product(a, b), compiled)


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match=r"a product of \(2, 3\) and \(2,\)"):
        la.product(np.ones((2, 3)), np.ones(2))


@pytest.mark.kernel
@sweep(few=30, many=200)
@given(SIZES, st.integers(0, 99))
def test_a_factor_is_the_plain_one_and_solves(n, seed):
    matrix = positive(n, seed)
    factor = la.cholesky(matrix)
    assert np.array_equal(factor, plain_factor(matrix))
    right = np.random.default_rng(seed).standard_normal((n, 4))
    assert plain_product(factor, la.solve_lower(factor, right.copy())) == pytest.approx(right, abs=1e-9)
    solved = la.solve_positive(matrix, right)
    assert plain_product(matrix, solved) == pytest.approx(right, abs=1e-9)
    assert np.array_equal(la.solve_positive(matrix, right[:, 1]), solved[:, 1])
    inverse = la.inverse_of_factor(factor)
    assert plain_product(matrix, inverse) == pytest.approx(np.eye(n), abs=1e-9)
    assert np.array_equal(inverse, inverse.T)


@pytest.mark.parametrize("matrix", [[[1.0, 2.0], [2.0, 1.0]], [[0.0]], [[np.nan]], [[np.inf]], -np.eye(60)])
def test_what_is_not_positive_is_told(matrix):
    for function in (la.cholesky, lambda m: la.solve_positive(m, m)):
        with pytest.raises(np.linalg.LinAlgError):
            function(np.array(matrix))


@pytest.mark.parametrize("name", ["exp", "log", "sin", "cos", "expm1"])
@pytest.mark.parametrize("count", [0, 1, 64, 65, 1000])
def test_functions_are_those_of_the_library_of_c(name, count):
    x = np.random.default_rng(count).uniform(0.1, 20.0, count)
    found = getattr(la, name)(x)
    assert found.tolist() == [getattr(math, name)(one) for one in x.tolist()]
    assert found.dtype == np.float64
    if name in ("exp", "log", "sin"):
        single = getattr(la, name)(x.astype(np.float32).reshape(-1, 1))
        assert (single.dtype, single.shape) == (np.float32, (count, 1))
        # A part is a part of the whole, however it is computed.
        assert np.array_equal(getattr(la, name)(x[:7].astype(np.float32)), single[:7, 0])
        assert single[:, 0] == pytest.approx(found, rel=1e-6, abs=2e-6)


def test_functions_of_what_has_no_number():
    with np.errstate(all="ignore"):
        assert la.exp(np.array([-np.inf, 800.0, np.inf])).tolist() == [0.0, np.inf, np.inf]
        assert la.log(np.array([0.0, np.inf])).tolist() == [-np.inf, np.inf]
        assert np.isnan(la.log(np.array([-1.0, np.nan]))).all()
    out = np.array([0.5, 1.0], np.float32)
    assert la.exp(out, out=out) is out
    assert la.arctan2(np.array([1.0, 0.0]), np.array([0.0, -1.0])).tolist() == [math.pi / 2, math.pi]


# What numpy, OpenBLAS and LAPACK compute in another way on another processor.
LEFT_TO_THE_PROCESSOR = re.compile(
    "matmul|dot|vdot|inner|tensordot|einsum|convolve|correlate|polyfit|cov|corrcoef|exp|exp2|expm1|log|log2|"
    "log10|log1p|sin|cos|tan|arcsin|arccos|arctan|arctan2|sinh|cosh|tanh|power|float_power|cbrt|"
    r"linalg\.(norm|solve|inv|pinv|cholesky|lstsq|svd|qr|eig|eigh|det|slogdet|matrix_power|multi_dot)"
)
ALLOWED = {
    "wbf_mission/addons/authors/sklearn_gp.py": "scikit-learn's own",
    "wbf_mission/addons/paper/cost.py": "values to measure the time with",
    "wbf_mission/addons/export/rerun.py": "drawn",
    "wbf_mission/addons/treatment/gis.py": "the georeference of a picture, checked to a tolerance",
}


def left_to_the_processor(source):
    tree = ast.parse(source)
    compiled = {
        id(inner)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef)
        and any("compiled" in ast.unparse(one) for one in function.decorator_list)
        for inner in ast.walk(function)
    }
    for node in ast.walk(tree):
        match node:
            case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.MatMult()):
                yield node.lineno, "@"
            case ast.Attribute(value=ast.Name("np") | ast.Attribute(ast.Name("np"), "linalg")):
                name = ast.unparse(node).removeprefix("np.")
                # In compiled code functions are those of C; products are BLAS's there, too.
                is_left = LEFT_TO_THE_PROCESSOR.fullmatch(name) is not None
                if is_left and (id(node) not in compiled or is_product(name)):
                    yield node.lineno, name
            case ast.ImportFrom(module=str(module)) if module.startswith(("scipy.linalg", "sklearn.")):
                if module != "sklearn.base":
                    yield node.lineno, module
            case ast.Constant(value="L-BFGS-B" | "SLSQP" | "BFGS"):
                yield node.lineno, node.value
            case ast.keyword(arg="fastmath", value=ast.Constant(value=True)):
                yield node.value.lineno, "fastmath"
            case ast.Call(func=ast.Attribute(attr="argsort")) if "kind" not in ast.unparse(node):
                yield node.lineno, "argsort, where equal numbers are in any order"


def is_product(name):
    return name.startswith("linalg.") or name in ("dot", "vdot", "matmul", "inner", "tensordot")


def test_no_module_leaves_what_is_recorded_to_the_processor():
    files = [path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))]
    found = {
        path.relative_to(ROOT).as_posix(): there
        for path in files
        if (there := list(left_to_the_processor(path.read_text(encoding="utf-8"))))
    }
    assert found.keys() == ALLOWED.keys(), {name: found.get(name) for name in found.keys() ^ ALLOWED.keys()}
