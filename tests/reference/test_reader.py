"""What may stand in place of an expression, and the one line that refuses anything else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.reference.reader import command_of, read_command


def read(spec: dict[str, Any], folder: Path = Path(), unit: str = "rad") -> Any:
    return read_command(spec, folder=folder, unit=unit, where="m.toml: simulation.reference")


def test_a_file_is_found_beside_the_model_and_converted(tmp_path: Path) -> None:
    (tmp_path / "gait.csv").write_text("# recorded\nt;angle;load\n0;0;1\n\n0.5;90;1\n1;180;2\n")
    found = read({"file": "gait.csv", "column": "angle", "unit": "deg", "filter": 4}, tmp_path)
    assert found.t == (0.0, 0.5, 1.0)
    np.testing.assert_allclose(found.y, [0.0, np.pi / 2, np.pi], rtol=1e-15)
    assert found.summary["file"] == "gait.csv"
    assert found.summary["unit"] == "deg"
    assert len(found.summary["file_sha256"]) == 64
    np.testing.assert_allclose(read({"file": "gait.csv", "unit": "mrad"}, tmp_path).y, [0.0, 0.09, 0.18])


def test_a_trapezoid_is_its_corners() -> None:
    found = read(
        {"trapezoid": {"high": 0.5, "start": 1.0, "rise": 0.5, "hold": 2.0, "rest": 0.5, "repeat": 2}}
    )
    np.testing.assert_allclose(found.t, [1.0, 1.5, 3.5, 4.0, 4.5, 5.0, 7.0, 7.5])
    np.testing.assert_allclose(found.y, [0.0, 0.5, 0.5, 0.0, 0.0, 0.5, 0.5, 0.0])
    triangle = read({"trapezoid": {"low": -1.0, "high": 1.0, "rise": 1.0, "repeat": 2}})
    np.testing.assert_allclose(triangle.t, [0.0, 1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(triangle.y, [-1.0, 1.0, -1.0, 1.0, -1.0])


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({}, "simulation.reference: has none of the keys that say what it is; allowed: one of steps, ramps"),
        ({"steps": [[0, 0]], "ramps": [[0, 0]]}, "has steps and ramps"),
        ({"steps": []}, "reference.steps: is []; allowed: [[t, y], ...]"),
        ({"steps": [[0, 0], [0, 1]]}, "reference.steps: point 2: t = 0 does not follow 0"),
        ({"table": [[0, 0], [1, float("nan")]]}, "reference.table: point 2 is (1, nan)"),
        ({"ramps": [[0, 0, 1]]}, "allowed: [[t, y], ...]"),
        ({"steps": [[0, 0]], "filter": 0}, "reference.filter: is 0; allowed: a number greater than 0"),
        ({"steps": [[0, 0]], "filtr": 2}, "has no key 'filtr'; did you mean filter?"),
        ({"steps": [[0, 0]], "unit": "kg"}, "reference.unit: 'kg' does not convert to 'rad'"),
        ({"steps": [[0, 0]], "unit": 3}, "reference.unit: is 3"),
        ({"trapezoid": {"high": 1}}, "reference.trapezoid: has no rise"),
        ({"trapezoid": {"high": 1, "rise": 0}}, "trapezoid.rise: is 0"),
        ({"trapezoid": {"high": 1, "rise": 1, "repeat": 0.5}}, "trapezoid.repeat: is 0.5"),
        ({"trapezoid": 3}, "reference.trapezoid: is 3"),
        ({"file": "no.csv"}, "no.csv: cannot be read"),
        ({"file": 3}, "reference.file: is 3"),
        ({"file": "bad.csv", "column": "angel"}, "bad.csv: has no column 'angel'; did you mean angle?"),
        ({"file": "bad.csv", "column": "angle"}, "line 3, column angle: 'x' is not a finite number"),
        ({"file": "bad.csv", "column": "short"}, "line 4, column short: nothing is not a finite number"),
        ({"file": "bad.csv", "time": "back", "column": "t"}, "line 3, column back: 1 does not follow 2"),
        ({"file": "empty.csv"}, "empty.csv: has no rows"),
    ],
)
def test_refusals_are_one_line(spec: dict[str, Any], message: str, tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("t,angle,back,short\n0,1,2,1\n1,x,1,1\n2,3,0\n")
    (tmp_path / "empty.csv").write_text("t,y\n")
    with pytest.raises(UsageError) as caught:
        read(spec, tmp_path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_references_from_python() -> None:
    times = np.linspace(0.0, 1.0, 11)

    def read_any(given: object) -> Any:
        return command_of(given, instants=lambda: times, unit="rad")

    by_function = read_any(np.sin)
    assert by_function.t == tuple(times.tolist())
    assert by_function.y == tuple(np.sin(times).tolist())
    assert read_any(times**2).y == tuple((times**2).tolist())
    pair = read_any((times, times**3))
    assert (pair.t, pair.y) == (tuple(times.tolist()), tuple((times**3).tolist()))
    assert read_any(np.column_stack([times, times**3])) == pair
    assert read_any({"table": np.column_stack([times, times**3]), "filter": 2.0}).filter == 2.0
    for given, message in (
        (times[:-1], "has 11 times and 10 values"),
        ("sin(t)", "allowed: numbers, as"),
        (np.zeros((2, 3)), "allowed: [[t, y], ...]"),
        ((times, times[:2]), "has 11 times and 2 values"),
        (lambda t: np.inf, "point 1 is (0, inf)"),
    ):
        with pytest.raises(UsageError) as caught:
            read_any(given)
        assert message in str(caught.value)
