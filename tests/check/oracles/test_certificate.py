"""The certificate's numbers, evaluated from derive's equations: against the paper's, SciPy and runs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from pmjoint_codegen.check import trajectory
from pmjoint_codegen.check.gates import proof
from pmjoint_codegen.check.oracles.certificate import certify, estimation_gain
from pmjoint_codegen.check.subject import Subject


def test_the_papers_constants(paper: Subject) -> None:
    found = certify(paper.derivation, proof.design_values(paper.derivation), 0.1)
    assert np.array_equal(found.P, [[1.5, -1.0], [-1.0, 0.9375]])
    assert sorted(found.poles.real) == pytest.approx([-4, -2])
    eigenvalue = float(np.linalg.eigvalsh(found.P)[-1])
    assert found.f_minus == 2.5
    assert found.f_plus == pytest.approx(eigenvalue / 0.2)
    assert (round(found.f, 4), round(found.Y or 0, 4), round(found.z_bound or 0, 2)) == (0.2215, 0.5097, 2.15)


def test_sharp_bounds_hold_along_the_run_and_are_sharper(paper: Subject) -> None:
    assert paper.compiled is not None
    found = certify(paper.derivation, proof.design_values(paper.derivation), 0.1)
    run = trajectory.default_run(paper.compiled)
    late = run.t > 10
    z = np.hypot(run["z1"][late], run["z2"][late])
    assert found.z_sharp is not None and found.z1_sharp is not None and found.z_bound is not None
    assert z.max() <= found.z_sharp < found.z_bound
    assert np.abs(run["z1"][late]).max() <= found.z1_sharp < found.z_bound


def test_without_a_disturbance_bound_there_is_no_ultimate_bound(paper: Subject) -> None:
    found = certify(paper.derivation, proof.design_values(paper.derivation), None)
    assert (found.Y, found.z_bound, found.z_sharp, found.z1_sharp) == (None, None, None, None)
    assert "no disturbance_bound" in found.lines()[-1]


def test_p_is_that_of_scipys_solver(paper: Subject) -> None:
    values = proof.design_values(paper.derivation)
    found = certify(paper.derivation, values, 0.1)
    A0 = np.array([[-values["k1"], 1.0], [-values["k2"], 0.0]])
    P = solve_continuous_lyapunov(A0.T, -2 * np.eye(2))
    assert np.abs(found.P - P).max() < 1e-14


@pytest.mark.parametrize(
    ("A0", "gain"),
    [
        ([[-3.0]], 0.0),
        ([[-1.0, 0.0], [0.0, -4.0]], 1 / 4),  # |row 2| = exp(-4 t)
        ([[-1e-2, 0.0], [0.0, -1e3]], 1e-3),  # a slow pole beside a fast one
        ([[-1e3, 0.0], [0.0, -1e-2]], 100.0),
        ([[-0.1, 50.0], [-50.0, -0.1]], 10.0),  # a rotation does not change the size
        ([[-1e-3, 50.0], [-50.0, -1e-3]], np.inf),  # too many periods to be counted
        ([[-2.0, 0.0], [1.0, -2.0]], None),  # a double pole: |row 2| = exp(-2 t) sqrt(1 + t^2)
    ],
)
def test_the_largest_effect_of_a_disturbance_on_epsilon_2(A0: list[list[float]], gain: float | None) -> None:
    if gain is None:
        t, weights = np.polynomial.laguerre.laggauss(80)
        gain = float(np.sum(weights * np.sqrt(1 + (t / 2) ** 2)) / 2)
    assert estimation_gain(np.array(A0)) == pytest.approx(gain, rel=1e-8)
