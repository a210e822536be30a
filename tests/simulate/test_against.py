"""A recorded run beside a simulated one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.main import run as command
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.simulate.against import differences, read_log
from pmjoint_codegen.simulate.figures import overview
from pmjoint_codegen.simulate.run import Run


@pytest.fixture(scope="module")
def run(root: Path, cache: Path) -> Run:
    return ClosedLoop.load(root / "models" / "paper.toml").simulate(horizon=2.0)


def written(path: Path, run: Run) -> Path:
    """A log every 20 ms, 0.1 rad off once, in degrees, longer than the run."""
    y = np.degrees(run["y"][::2])
    y[30] += np.degrees(0.1)
    columns = run.t[::2], y, run["x2"][::2]
    rows = [f"{t:.17g},{value:.17g},{x2:.17g}" for t, value, x2 in zip(*columns, strict=True)]
    path.write_text("\n".join(["time [s],angle (deg),x2,other", *(f"{row},0" for row in rows), "9,0,0,0"]))
    return path


def test_differences_by_name_and_unit(run: Run, tmp_path: Path) -> None:
    log = read_log(written(tmp_path / "log.csv", run), run, ["y=angle"])
    assert log.names == {"x2": "x2", "y": "angle"}
    found = differences(run, log)
    assert found["instants"] == 101
    y = found["columns"]["y"]
    assert (y["column"], y["unit"], y["at"]) == ("angle", "rad", run.t[60])
    assert y["max"] == pytest.approx(0.1, abs=1e-12)
    assert y["rms"] == pytest.approx(0.1 / np.sqrt(101), abs=1e-12)
    assert found["columns"]["x2"]["max"] == 0.0


def test_the_log_is_drawn_over_its_curves(run: Run, tmp_path: Path) -> None:
    log = read_log(written(tmp_path / "log.csv", run), run, ["y=angle"])
    drawn, plain = (overview(run, log=one).axes[0].lines for one in (log, None))
    assert len(drawn) == len(plain) + 1
    (dots,) = (line for line in drawn if line.get_marker() == ".")
    np.testing.assert_array_equal(dots.get_ydata(), log.columns["y"][:-1])


@pytest.mark.parametrize(
    ("text", "chosen", "message"),
    [
        ("t,angle\n0,1\n", [], "has no column of the run (t, angle); name one: --against-column y=COLUMN"),
        ("t,y [kg]\n0,1\n", [], "'kg' does not convert to 'rad'"),
        ("t,y\n0,1\n", ["z=y"], "is 'z=y': the run has no column 'z'"),
        ("t,angle\n0,1\n", ["y=angel"], "has no column 'angel'; did you mean angle?"),
        ("t,angle\n0,1\n", ["y"], "--against-column: is 'y'"),
        ("t,y\n5,1\n6,1\n", [], "--against log.csv: is from t = 5 to 6 s, outside the run"),
    ],
)
def test_refusals(run: Run, tmp_path: Path, text: str, chosen: list[str], message: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(UsageError) as caught:
        differences(run, read_log(path, run, chosen))
    assert message in str(caught.value)


def test_on_the_command_line(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], root: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    log = written(tmp_path / "log.csv", run)
    model = str(root / "models" / "paper.toml")
    asked = ["simulate", model, "--horizon", "2", "--no-figures", "--out", str(tmp_path / "out")]
    assert command([*asked, "--against", str(log), "--against-column", "y=angle"]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["against"]["columns"]["y"]["max"] == pytest.approx(0.1, abs=1e-12)
    assert "y: rms 0.00995037 rad, at most 0.1 rad at 0.6 s" in capsys.readouterr().out
    assert command([*asked, "--against-column", "y=angle"]) == 2
    assert "belongs to --against" in capsys.readouterr().err


def test_a_reference_from_a_file_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], root: Path
) -> None:
    pytest.importorskip("casadi")
    gait, out = tmp_path / "gait.csv", tmp_path / "out"
    gait.write_text("time,knee\n0,0\n1,30\n2,0\n")
    model = str(root / "models" / "paper.toml")
    asked = ["simulate", model, "--horizon", "2", "--no-figures", "--out", str(out), "--reference"]
    assert command([*asked, str(gait), "--reference-unit", "deg", "--reference-filter", "20"]) == 0
    assert "y_r = gait.csv, knee, 3 points, filter 20 1/s" in capsys.readouterr().out
    said = json.loads((out / "summary.json").read_text())["reference"]
    assert (said["kind"], said["column"], said["unit"], said["filter"]) == ("file", "knee", "deg", 20.0)
    assert command([*asked, "sin(t)", "--reference-filter", "20"]) == 2
    assert "--reference-filter belongs to a .csv file" in capsys.readouterr().err
    assert command([*asked, str(gait), "--reference-column", "hip"]) == 2
    assert "gait.csv: has no column 'hip'" in capsys.readouterr().err
