"""The wheel carries all that the checkout has, and simulates where there is no checkout."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

CARRIED = {
    **{name: f"pmjoint_codegen/_data/{name}" for name in ("models", "generated", "golden")},
    "derive": "pmjoint_derive",
}


def succeed(*command: str, cwd: Path, **env: str) -> str:
    """Run a command, require exit code 0, and return its standard output."""
    done = subprocess.run(
        command,
        check=False,
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **env},
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel with what is installed; nothing is fetched."""
    folder = tmp_path_factory.mktemp("wheel")
    succeed(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder), cwd=root)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel into a folder of its own, outside the checkout."""
    target = tmp_path_factory.mktemp("installed")
    pip = [sys.executable, "-m", "pip", "-q", "--disable-pip-version-check", "install"]
    succeed(*pip, "--no-deps", "--no-index", "--target", str(target), str(wheel), cwd=target)
    return target


def test_wheel_holds_the_checkout(root: Path, wheel: Path) -> None:
    listing = succeed("git", "ls-files", "--", *CARRIED, "pmjoint_codegen", cwd=root)
    expected = set()
    for name in listing.splitlines():
        top, _, rest = name.partition("/")
        expected.add(f"{CARRIED.get(top, top)}/{rest}")
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert expected - held == set()
    assert {name.partition("/")[0] for name in held} == {"pmjoint_codegen", "pmjoint_derive"}
    assert {
        "pmjoint_codegen/_data/models/paper.toml",
        "pmjoint_codegen/_data/generated/paper/kernels.c",
        "pmjoint_codegen/_data/generated/paper/loops.c",
    } <= held
    assert [name for name in held if name.endswith((".pyc", ".so", ".o"))] == []


def test_wheel_simulates_outside_the_checkout(installed: Path, tmp_path: Path) -> None:
    where = "import pmjoint_codegen; print(pmjoint_codegen.__file__)"
    env = {"PYTHONPATH": str(installed)}
    assert Path(succeed(sys.executable, "-c", where, cwd=tmp_path, **env).strip()).is_relative_to(installed)
    simulate = [sys.executable, "-m", "pmjoint_codegen", "simulate", "paper"]
    succeed(*simulate, "--horizon", "1", "--no-figures", cwd=tmp_path, **env)
    summary = json.loads((tmp_path / "runs" / "paper" / "summary.json").read_text(encoding="utf-8"))
    assert summary["model"] == "paper"
    assert len(summary["saturation_switches"]) >= 3
    assert (tmp_path / "runs" / "paper" / "trajectory.csv").read_text(encoding="utf-8").count("\n") == 102


def test_wheel_derives_outside_the_checkout(installed: Path, tmp_path: Path) -> None:
    simulate = [sys.executable, "-m", "pmjoint_codegen", "simulate", "paper", "--reference", "0.5*cos(t)"]
    succeed(
        *simulate,
        "--horizon",
        "0.5",
        "--no-figures",
        "--out",
        "other",
        cwd=tmp_path,
        PYTHONPATH=str(installed),
    )
    assert (tmp_path / "other" / "summary.json").is_file()


@pytest.fixture(params=["checkout", "wheel"])
def path(request: pytest.FixtureRequest, root: Path) -> Path:
    """Return the folder that the packages are imported from."""
    return root if request.param == "checkout" else request.getfixturevalue("installed")


def test_a_module_of_the_users_that_is_called_derive_is_left_alone(path: Path, tmp_path: Path) -> None:
    (tmp_path / "derive.py").write_text("raise RuntimeError('the wrong module')\n", encoding="utf-8")
    command = [sys.executable, "-m", "pmjoint_codegen", "derive", "paper", "--format", "json"]
    assert json.loads(succeed(*command, cwd=tmp_path, PYTHONPATH=str(path)))["equations"]


def test_wheel_checks_outside_the_checkout(installed: Path, tmp_path: Path) -> None:
    gates = [word for gate in ("current", "symbolic", "trajectory.golden") for word in ("--gate", gate)]
    command = [sys.executable, "-m", "pmjoint_codegen", "check", "paper", "--json", *gates]
    records = json.loads(succeed(*command, cwd=tmp_path, PYTHONPATH=str(installed)))
    assert [record["verdict"] for record in records] == ["passed"] * 3
