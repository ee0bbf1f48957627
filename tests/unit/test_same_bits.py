"""Nothing that makes a map rests on what one CPU rounds differently from another."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
from numba import njit

SHARED = Path(__file__).parents[2] / "shared" / "orograph"
ROOMS = ("mapping", "mission", "navigation", "nodes", "protocol", "scene", "sensing", "world")
FILES = [*SHARED.glob("*.py"), *(path for room in ROOMS for path in (SHARED / room).rglob("*.py"))]
BY_CPU = {
    "linalg", "dot", "matmul", "inner", "vdot", "tensordot", "tan", "arcsin", "arccos", "arctan", "arctan2", "exp",
    "exp2", "expm1", "log", "log2", "log10", "log1p", "cbrt", "power", "float_power", "sinh", "cosh", "tanh",
    "fastmath", "parallel",
}  # fmt: skip
"""BLAS sums in the order of the CPU's registers, and NumPy has these functions once for each set of instructions."""


def rests_on_the_cpu(tree: ast.AST) -> list[int]:
    """Lines of matrix products, of NumPy's functions in BY_CPU, and of numba's switches in it."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            lines.append(node.lineno)
        if isinstance(node, ast.Attribute) and node.attr in BY_CPU and ast.unparse(node.value) == "np":
            lines.append(node.lineno)
        if isinstance(node, ast.keyword) and node.arg in BY_CPU:
            lines.append(node.value.lineno)
    return sorted(lines)


def test_no_map_rests_on_blas_or_on_vectorised_functions():
    found = [
        f"{path.relative_to(SHARED)}:{line}" for path in FILES for line in rests_on_the_cpu(ast.parse(path.read_text()))
    ]
    assert len(FILES) > 60
    assert not found, "plain sums, np.einsum and math.* round alike on every CPU"


def test_the_search_finds_what_it_looks_for():
    tree = ast.parse("a = b @ c\nd = np.linalg.norm(a)\ne = np.arctan2(a, b)\n@njit(fastmath=True)\ndef f(): ...\n")
    assert rests_on_the_cpu(tree) == [1, 2, 3, 4]


def test_compiled_loops_round_the_product_before_the_sum():
    @njit
    def compiled(a, b, c, out):
        for i in range(len(a)):
            out[i] = a[i] * b[i] + c[i]

    a, b, c = np.random.default_rng(1).normal(size=(3, 1000))
    out = np.empty(1000)
    compiled(a, b, c, out)
    product = a * b
    np.testing.assert_array_equal(out, product + c)
    exact = [float(np.longdouble(x) * np.longdouble(y) + np.longdouble(z)) for x, y, z in zip(a, b, c, strict=True)]
    assert (out != exact).any(), "a fused product and sum would show here"
