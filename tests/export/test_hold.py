"""The hold baked into the C: the bits of the computed one, for the model's sample time and gains alone."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
from collections.abc import Callable
from functools import cache as once
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.export.hold import BAKED, baked_matrices
from pmjoint_codegen.export.package import TRACE, Export, export_c
from pmjoint_codegen.export.recording import inputs
from pmjoint_codegen.export.trace import trace_faults

MODELS = ("paper", "third-order", "braking")
BAD_PARAMETER = 8
SAMPLES = 200
Make = Callable[..., Export]


def _baked(export: Export) -> Export:
    return export_c(export.program.derivation, export.identity, export.precision, BAKED)


@pytest.fixture(scope="module")
def baked_of(exports: Make) -> Make:
    """Export a model with the hold baked in, once."""
    return once(lambda name, precision="double": _baked(exports(name, precision)))


@pytest.fixture
def pair(exports: Make, baked_of: Make, cache: Path) -> Callable[..., tuple[Exported, Exported]]:
    """Compile and load a model with the hold computed, and baked in."""
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")

    def loaded(name: str, precision: str = "double") -> tuple[Exported, Exported]:
        export = exports(name, precision)
        return Exported.load(export, compiler, cache), Exported.load(
            baked_of(name, precision), compiler, cache
        )

    return loaded


def _bits(values: Any) -> bytes:
    return struct.pack(f"{len(values)}d", *values)


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("name", MODELS)
def test_matrices_and_every_sample_have_the_bits_of_the_computed_hold(
    name: str, precision: str, pair: Callable[..., tuple[Exported, Exported]]
) -> None:
    both = pair(name, precision)
    export = both[0].export
    given = [inputs(export.program, export.precision, k, 1.0) for k in range(SAMPLES)]
    for loaded in both:
        assert loaded.call("self_test") == 0
        assert loaded.init(given[0][0], np.array(given[0][1])) == 0
    assert any(both[0].hold()) and _bits(both[0].hold()) == _bits(both[1].hold())
    for y, y_r, measured in given:
        flags = [loaded.step(y, np.array(y_r), measured) for loaded in both]
        assert flags[0] == flags[1]
        assert _bits(both[0].states) == _bits(both[1].states)
        assert _bits([both[0].output.v, both[0].output.u]) == _bits([both[1].output.v, both[1].output.u])


def test_init_refuses_another_sample_time_and_another_gain_of_the_hold(
    pair: Callable[..., tuple[Exported, Exported]],
) -> None:
    computed, baked = pair("paper")
    y_r = np.zeros(3)
    for name in ("sample_time", "k1", "k2", "ck1", "ck2"):
        own = getattr(baked.params, name)
        for other in (own * (1.0 + 2.0**-52), own * (1.0 - 2.0**-53), 2.0 * own, float("nan")):
            setattr(baked.params, name, other)
            assert baked.init(1.0, y_r) == BAD_PARAMETER, name
        setattr(computed.params, name, 2.0 * own)
        assert computed.init(1.0, y_r) == 0
        setattr(baked.params, name, own)
        assert baked.init(1.0, y_r) == 0
    baked.params.c1 *= 2.0  # no part of the hold
    assert baked.init(1.0, y_r) == 0


@pytest.mark.parametrize("precision", ["double", "float"])
def test_make_test_holds_and_the_object_is_smaller(
    precision: str, exports: Make, baked_of: Make, tmp_path: Path
) -> None:
    if any(shutil.which(tool) is None for tool in ("gcc", "make", "size")):
        pytest.skip("no gcc, make or size")
    sizes = []
    for place, item in enumerate((exports("paper", precision), baked_of("paper", precision))):
        folder = tmp_path / str(place)
        folder.mkdir()
        for name, text in item.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        done = subprocess.run(
            ["make", "-C", str(folder), "test", "CC=gcc"], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "") and "all holds" in done.stdout
        told = subprocess.run(
            ["size", f"{item.identity.prefix}.o"], cwd=folder, capture_output=True, text=True, check=True
        )
        sizes.append(int(told.stdout.splitlines()[1].split()[0]))
    assert sizes[1] < sizes[0] and sizes[1] > 0


def test_nothing_of_the_matrix_exponential_is_left(exports: Make, baked_of: Make) -> None:
    baked = baked_of("paper")
    for word in ("multiply", "balanced_norm", "frexp(", "ldexp(", "DEGREE", "A0["):
        assert word in exports("paper").source and word not in baked.source, word
    assert "`sample_time`, `ck1`, `ck2`, `k1`, `k2`" in baked.files["README.md"]
    assert "baked-in hold" in baked.files[f"{baked.identity.prefix}.h"]
    assert "@" not in baked.files["README.md"] + baked.source
    assert "aked-in" not in "".join(exports("paper").files.values())


@pytest.mark.parametrize("name", MODELS)
def test_the_trace_stays_right(name: str, baked_of: Make) -> None:
    baked = baked_of(name)
    entries = json.loads(baked.files[TRACE])
    assert trace_faults(baked.program, baked.source, entries, BAKED) == []
    assert trace_faults(baked.program, baked.source, entries) != []  # the terms of A0 have no line


def test_a_wrong_literal_is_seen(baked_of: Make) -> None:
    baked = baked_of("paper")
    value = baked_matrices(baked.program, baked.precision)["Fr"][0][1]
    old = f"c->Fr[0][1] = {value!r};"
    assert baked.source.count(old) == 1
    wrong = baked.source.replace(old, f"c->Fr[0][1] = {value * (1.0 + 1e-12)!r};")
    faults = trace_faults(baked.program, wrong, json.loads(baked.files[TRACE]), BAKED)
    assert [fault.split(":")[0] for fault in faults] == ["Fr[0][1]"]


def test_a_target_with_tunable_gains_says_why_it_takes_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["export", "paper", "--target", "c", "--target", "fmu", "--hold", "baked"]
    assert run([*asked, "--out", str(tmp_path / "x")]) == 2
    told = capsys.readouterr().err
    assert "fmu" in told and "tunable" in told
    assert not (tmp_path / "x").exists()
