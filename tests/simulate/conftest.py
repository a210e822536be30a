"""Evaluators: the paper's kernels, and a model of one state whose v is a given polynomial of t."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.initial import Start, Variable
from pmjoint_codegen.kernels import compiled, interpreted
from pmjoint_codegen.kernels.evaluator import Array, Evaluator, Kernel, Kind
from pmjoint_codegen.manifest import Function, GuardRule, Manifest, Parameter, Simulation

ORDER = 8
KERNELS_H = """
int pmjoint_reference(const double **arg, double **res, long long int *iw, double *w, int mem);
int pmjoint_actuation(const double **arg, double **res, long long int *iw, double *w, int mem);
int pmjoint_signals(const double **arg, double **res, long long int *iw, double *w, int mem);
int pmjoint_taylor(const double **arg, double **res, long long int *iw, double *w, int mem);
int pmjoint_guard(const double **arg, double **res, long long int *iw, double *w, int mem);
int pmjoint_closed_loop(const double **arg, double **res, long long int *iw, double *w, int mem);
"""
# x' = w = g0 + g1 v with v = p1 + p2 t + ... + p7 t^6, clipped at +-p0; y_r = 0. Polynomials of order 8 miss
# nothing of it, so the guard is 0.
KERNELS_C = """
#include "kernels.h"
#define DEGREE 6
#define ORDER 8
static double polynomial(const double *p, double t)
{
    double sum = 0.0;
    for (int k = DEGREE; k >= 0; --k) { sum = sum * t + p[1 + k]; }
    return sum;
}
int pmjoint_reference(const double **arg, double **res, long long int *iw, double *w, int mem)
{
    (void)arg; (void)iw; (void)w; (void)mem;
    res[0][0] = 0.0;
    res[0][1] = 0.0;
    return 0;
}
int pmjoint_actuation(const double **arg, double **res, long long int *iw, double *w, int mem)
{
    (void)iw; (void)w; (void)mem;
    res[0][0] = 0.0;
    res[0][1] = 1.0;
    res[0][2] = -arg[0][0];
    res[0][3] = arg[0][0];
    return 0;
}
int pmjoint_signals(const double **arg, double **res, long long int *iw, double *w, int mem)
{
    const double v = polynomial(arg[2], arg[0][0]);
    const double limit = arg[2][0];
    (void)iw; (void)w; (void)mem;
    res[0][0] = arg[1][0];
    res[0][1] = 0.0;
    res[0][2] = arg[1][0];
    res[0][3] = v;
    res[0][4] = v < -limit ? -limit : v > limit ? limit : v;
    return 0;
}
int pmjoint_taylor(const double **arg, double **res, long long int *iw, double *w, int mem)
{
    double v[ORDER + 1];
    (void)iw; (void)w; (void)mem;
    for (int k = 0; k <= ORDER; ++k) {
        double sum = 0.0;
        for (int j = DEGREE; j >= k; --j) {
            double choose = 1.0;
            for (int i = 0; i < k; ++i) { choose = choose * (j - i) / (i + 1); }
            sum = sum * arg[0][0] + choose * arg[3][1 + j];
        }
        v[k] = sum;
        res[0][3 * k + 1] = sum;
    }
    res[0][0] = arg[1][0];
    res[0][2] = arg[1][0];
    for (int k = 0; k < ORDER; ++k) {
        res[0][3 * (k + 1)] = (arg[2][1] * v[k] + (k == 0 ? arg[2][0] : 0.0)) / (k + 1);
        res[0][3 * (k + 1) + 2] = res[0][3 * (k + 1)];
    }
    return 0;
}
int pmjoint_guard(const double **arg, double **res, long long int *iw, double *w, int mem)
{
    (void)arg; (void)iw; (void)w; (void)mem;
    res[0][0] = res[0][1] = res[0][2] = 0.0;
    return 0;
}
int pmjoint_closed_loop(const double **arg, double **res, long long int *iw, double *w, int mem)
{
    const double v = polynomial(arg[3], arg[0][0]);
    (void)iw; (void)w; (void)mem;
    res[0][0] = arg[2][0] + arg[2][1] * v;
    res[1][0] = v;
    res[2][0] = arg[1][0];
    return 0;
}
"""


# What the sampled loop takes in; this model is not sampled.
SAMPLED_H = """
#ifndef SAMPLED_H
#define SAMPLED_H
#define PMJ_NX 1
#define PMJ_NS 2
#define PMJ_NW 1
#define PMJ_NP 8
#define PMJ_NH 1
#define PMJ_NK 0
#define PMJ_WINDOWS 1
#define PMJ_HOLD_ORDER 2
static inline void pmj_sample(const double *t, const double *X, const double *h, const double *p, double *v,
                              double *w, double *c, double *s_next)
{
    v[0] = w[0] = c[0] = s_next[0] = t[0] + X[0] + h[0] + p[0];
}
#endif
"""


class PolynomialEvaluator:
    """The same model in Python, for the twin."""

    kind: Kind = "interpreted"

    def __init__(self, manifest: Manifest) -> None:
        self.manifest = manifest

    def kernel(self, name: str) -> Kernel:
        kernels: dict[str, Kernel] = {
            "reference": lambda t, p: (np.zeros(2),),
            "actuation": lambda p: (np.array([0.0, 1.0, -p[0], p[0]]),),
            "signals": _signals,
            "taylor": _taylor,
            "guard": lambda *_: (np.zeros(3),),
            "closed_loop": _closed_loop,
        }
        return kernels[name]

    def call(self, name: str, *arrays: npt.ArrayLike) -> tuple[Array, ...]:
        given = [np.asarray(array, dtype=np.float64) for array in arrays]
        shape = np.broadcast_shapes(*(array.shape[:-1] for array in given))
        rows = [
            np.broadcast_to(array, (*shape, array.shape[-1])).reshape(-1, array.shape[-1]) for array in given
        ]
        found = np.array([self.kernel(name)(*row)[0] for row in zip(*rows, strict=True)])
        return (found.reshape(*shape, -1),)


def _signals(t: Array, X: Array, p: Array) -> tuple[Array, ...]:
    v = float(np.polynomial.Polynomial(p[1:])(t[0]))
    return (np.array([X[0], 0.0, X[0], v, min(max(v, -p[0]), p[0])]),)


def _taylor(t: Array, X: Array, g: Array, p: Array) -> tuple[Array, ...]:
    c = np.zeros((ORDER + 1, 3))
    for k in range(ORDER + 1):
        total = 0.0
        for j in range(6, k - 1, -1):
            total = total * float(t[0]) + math.comb(j, k) * float(p[1 + j])
        c[k, 1] = total
    c[0, 0] = X[0]
    for k in range(ORDER):
        c[k + 1, 0] = (g[1] * c[k, 1] + (g[0] if k == 0 else 0.0)) / (k + 1)
    c[:, 2] = c[:, 0]
    return (c.ravel(),)


def _closed_loop(t: Array, X: Array, g: Array, p: Array) -> tuple[Array, ...]:
    v = 0.0
    for coefficient in p[:0:-1].tolist():
        v = v * float(t[0]) + coefficient
    return np.array([g[0] + g[1] * v]), np.array([v]), X.copy()


def polynomial_manifest() -> Manifest:
    """Describe the model of one state."""
    names = ["limit", *(f"p{k}" for k in range(7))]
    sizes = {
        "reference": ((("t", 1), ("p", 8)), (("y_r", 2),)),
        "actuation": ((("p", 8),), (("limits", 4),)),
        "signals": ((("t", 1), ("X", 1), ("p", 8)), (("signals", 5),)),
        "taylor": ((("t", 1), ("X", 1), ("g", 2), ("p", 8)), (("c", 3 * (ORDER + 1)),)),
        "guard": ((("t", 1), ("X", 1), ("g", 2), ("p", 8), ("R", 1), ("P", 1)), (("rest", 3),)),
        "closed_loop": (
            (("t", 1), ("X", 1), ("g", 2), ("p", 8)),
            (("X_dot", 1), ("v", 1), ("e", 1)),
        ),
    }
    return Manifest(
        name="polynomial",
        title="",
        source="",
        model_hash="",
        versions={},
        n=1,
        m=0,
        rho=1,
        p=0,
        nx=1,
        nw=1,
        order=ORDER,
        limit="limit",
        chain={},
        leading="limit",
        disturbance_bound=None,
        linear=(),
        kinks=(),
        windows=True,
        guards={"taylor": GuardRule(ORDER, (), 1.0, 0.1)},
        states=(Variable("x1", "", ""),),
        start=Start((Variable("x1", "", ""),), 1, ("x1",), ()),
        blocks={"x": (0, 1)},
        parameters=tuple(Parameter(name, 1.0, "", "", "plant") for name in names),
        chosen=(),
        rules=(),
        signals=tuple(Variable(name, "", "") for name in ("y", "y_r", "e", "v", "u")),
        partials=(),
        functions=tuple(Function(name, *size, "", "", 0) for name, size in sizes.items()),
        simulation=Simulation("0", ("0",), (0.0,), 1.0, 0.1, 0.1, False, "zero"),
        files={},
    )


@pytest.fixture(scope="session")
def interpreted_paper(root: Path) -> interpreted.InterpretedEvaluator:
    pytest.importorskip("casadi")
    folder = root / "generated" / "paper"
    return interpreted.load(folder, Manifest.read(folder))


@pytest.fixture(scope="session", params=["compiled_paper", "interpreted_paper"])
def paper(request: pytest.FixtureRequest) -> Evaluator:
    """Give the paper's kernels, either way."""
    evaluator: Evaluator = request.getfixturevalue(request.param)
    return evaluator


@pytest.fixture(scope="session", params=["C", "Python"])
def polynomial_model(
    request: pytest.FixtureRequest, cache: Path, tmp_path_factory: pytest.TempPathFactory
) -> Evaluator:
    """Give the model of one state, in C and in Python."""
    manifest = polynomial_manifest()
    if request.param == "Python":
        return PolynomialEvaluator(manifest)
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("polynomial")
    (folder / "kernels.h").write_text(KERNELS_H)
    (folder / "kernels.c").write_text(KERNELS_C)
    (folder / "loops.c").write_text("")
    (folder / "sampled.h").write_text(SAMPLED_H)
    return compiled.load(folder, manifest, compiler, cache)
