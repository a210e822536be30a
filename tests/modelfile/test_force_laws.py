"""Named laws of force, against geometry and against the form and units of their sources."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
import sympy as sp

from pmjoint_codegen.modelfile.expressions import parse
from pmjoint_codegen.modelfile.force_laws import FORCE_LAWS
from pmjoint_codegen.modelfile.units import Scales, Wanted
from pmjoint_derive import real_symbol
from pmjoint_derive.force import CONTRACTION, PRESSURE, Force, split

SCALES = Scales("force laws")  # one: it loads its table of units once


def law(name: str) -> Force:
    found = FORCE_LAWS[name]
    names = ("P", "eps", *found.constants, "C1", "C2", "C3", "C4")
    return split(parse(found.formula, {item: real_symbol(item) for item in names}, name))


def force(name: str, pressure: float, contraction: float, **given: float) -> float:
    """Force of a law at its own values, and at those given."""
    constants = {key: item.value for key, item in FORCE_LAWS[name].constants.items()} | given
    values = {real_symbol(key): value for key, value in constants.items()}
    return float(
        law(name).at(PRESSURE, CONTRACTION).subs({PRESSURE: pressure, CONTRACTION: contraction}).subs(values)
    )


@pytest.mark.parametrize("name", FORCE_LAWS)
def test_each_law_is_affine_in_pressure_and_states_its_source(name: str) -> None:
    found = law(name)
    assert found.gain.free_symbols and PRESSURE not in found.gain.free_symbols | found.passive.free_symbols
    assert FORCE_LAWS[name].source
    for key, constant in FORCE_LAWS[name].constants.items():
        assert constant.about
        SCALES.of(constant.example, f"{name}.{key}", Wanted(constant.unit, constant.unit))  # of its dimension


@pytest.mark.parametrize("contraction", [-0.02, 0.0, 0.1, 0.25])
def test_the_braid_s_force_is_the_work_of_pressure(contraction: float) -> None:
    """F = -P dV/dl of a cylinder whose threads, n turns of fixed length b, wind about it."""
    D0, alpha0, length, pressure = 0.02, math.radians(25), 0.3, 4e5
    b = length / math.cos(alpha0)
    turns = b * math.sin(alpha0) / (math.pi * D0)

    def volume(l: float) -> float:  # noqa: E741 - length, as the source has it
        return (b**2 - l**2) / (4 * math.pi * turns**2) * l

    l, step = length * (1 - contraction), 1e-6  # noqa: E741
    expected = -pressure * (volume(l + step) - volume(l - step)) / (2 * step)
    given = {"D0": D0, "alpha0": alpha0}
    assert force("chou-hannaford", pressure, contraction, **given) == pytest.approx(expected, rel=1e-6)
    assert force("tondu-lopez", pressure, contraction / 1.3, k_end=1.3, **given) == pytest.approx(
        expected, rel=1e-6
    )


@pytest.mark.parametrize("name", ["hunt-10", "hunt-20", "hunt-40"])
def test_hunt_s_fits_are_1_without_contraction_and_0_at_the_greatest(name: str) -> None:
    """Their normalisation: F_max at P_ref without contraction, no force at P_ref and eps_max."""
    given = {"eps_max": 0.17, "F_max": 1000.0}
    assert force(name, 620e3, 0.0, **given) == pytest.approx(1000.0)
    assert force(name, 620e3, 0.17, **given) == pytest.approx(0.0, abs=0.012 * 1000)
    assert force(name, 0.0, 0.0, **given) == 0.0


SAROSI = {  # for p in bar and the contraction in percent, as quoted
    "sarosi-dmsp-10": (-9.2194029, 203.7012413, -0.34221042, -3.2255991, 109.2038216, -208.372034),
    "sarosi-dmsp-20-200": (-4.00180705, 292.4620246, -0.32930845, -9.33564098, 294.0538256, -280.498151),
    "sarosi-dmsp-20-400": (-4.35573, 281.22370, -0.32866, -9.27035, 302.20107, -263.69185),
}


@pytest.mark.parametrize("name", SAROSI)
@pytest.mark.parametrize(("bar", "percent"), [(0.5, 0.0), (3.0, 12.0), (6.0, 1.5)])
def test_sarosi_s_fits_are_those_for_bar_and_percent(name: str, bar: float, percent: float) -> None:
    a, b, c, d, e, f = SAROSI[name]
    expected = (a * bar + b) * math.exp(c * percent) + d * bar * percent + e * bar + f
    assert force(name, bar * 1e5, percent / 100) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("name", "largest"), [("sarosi-dmsp-10", 650), ("sarosi-dmsp-20-200", 1800)])
def test_sarosi_s_muscles_are_of_the_size_that_the_maker_states(name: str, largest: float) -> None:
    """At 6 bar the force is about the stated one, and a free muscle shortens by about a quarter."""
    assert 0.8 * largest < force(name, 6e5, 0.0) < largest
    assert force(name, 6e5, 0.15) > 0 > force(name, 6e5, 0.30)


def test_the_paper_s_law_is_2() -> None:
    C1, C2, C3, C4 = (real_symbol(name) for name in ("C1", "C2", "C3", "C4"))
    found = law("paper")
    assert sp.expand(found.gain - (C1 * CONTRACTION**2 + C2 * CONTRACTION + C3)) == 0
    assert found.passive == C4


def test_the_page_of_models_has_every_law_as_it_is() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "models.md").read_text(encoding="utf-8")
    table = page.partition("| name | F | needs | source |\n")[2].partition("\n\n")[0]
    rows = [line for line in table.splitlines() if line.startswith("| `")]
    for name, found in FORCE_LAWS.items():
        (row,) = (line for line in rows if f"`{name}`" in line.split("|")[1])
        if "the same" not in row.split("|")[2]:
            assert f"`{found.formula}`" in row
        needed = {key for key, item in found.constants.items() if item.value is None}
        stated = row.split("|")[3]
        of_needs = {key for key in found.constants if re.search(rf"\b{key}\b", stated)}
        if "all but" in stated:
            of_needs = set(found.constants) - of_needs
        elif "..." in stated:  # the first and the last one
            needed = {min(needed), max(needed)} if needed else set()
        assert of_needs == needed
