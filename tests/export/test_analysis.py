"""Frama-C's Eva on the exported C: no alarm in any number of steps from any state; u within the limits."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.export.package import Export

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="no make")
needs_frama_c = pytest.mark.skipif(shutil.which("frama-c") is None, reason="no frama-c")
CLAMPED, RANGE = 16, 1e9
REST = np.zeros(3)


def analysed(export: Export, folder: Path, **changes: str) -> tuple[int, str]:
    """Analyse an export whose C has some text replaced; the exit code and what Eva wrote."""
    for name, text in export.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    source = folder / f"{export.identity.prefix}.c"
    for old, new in changes.items():
        assert old in export.source
        source.write_text(export.source.replace(old, new), encoding="utf-8")
    done = subprocess.run(
        ["make", "-C", str(folder), "analyse"], capture_output=True, text=True, check=False, timeout=120
    )
    return done.returncode, (folder / "analysis.txt").read_text(encoding="utf-8")


@needs_frama_c
@pytest.mark.parametrize(
    ("name", "precision"),
    [
        ("paper", "double"),
        ("paper", "float"),
        ("joint-exact", "double"),
        ("joint-exact", "float"),
        ("chain", "double"),
        ("third-nonlinear", "double"),
        ("paper-adaptive", "double"),
        ("paper-adaptive", "float"),
    ],
)
def test_eva_has_no_alarm(name: str, precision: str, exports: Callable[..., Export], tmp_path: Path) -> None:
    code, told = analysed(exports(name, precision), tmp_path)
    assert code == 0, told
    assert "  0 alarms generated" in told


@needs_frama_c
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("return kept;", "return value;"),  # states without end
        ("const double z1 = s->y", "const double z1 = (1.0 / s->y) + s->y"),  # a division by 0
        (
            "s->command = between(v, -p->u_max, p->u_max);",
            "s->command = between(v, -p->u_max, p->u_max + 1.0);",
        ),
    ],
)
def test_eva_sees_what_is_wrong(old: str, new: str, exports: Callable[..., Export], tmp_path: Path) -> None:
    code, told = analysed(exports("paper"), tmp_path, **{old: new})
    assert code != 0, told


def test_a_state_beyond_its_range_is_put_there_and_flagged(load: Callable[..., Exported]) -> None:
    loaded = load("paper")
    assert loaded.init(0.1, REST) == 0
    assert loaded.step(0.1, REST) == 0
    loaded.state.lambda1 = -1e12
    assert loaded.step(0.1, REST) == CLAMPED
    assert loaded.state.lambda1 == -RANGE
    assert abs(loaded.output.u) == loaded.params.u_max  # v and u go on
    assert loaded.output.flags == CLAMPED
