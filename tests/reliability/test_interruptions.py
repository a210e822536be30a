"""Killed, starved, locked out: what a command leaves is whole, and the next one succeeds."""

from __future__ import annotations

import math
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from pmjoint_codegen.emit.regenerate import regenerate

SHORT = ("simulate", "models/paper.toml", "--horizon", "0.1", "--no-figures", "--json")


@pytest.fixture
def project(root: Path, tmp_path: Path) -> Path:
    """A project of the user's own with the paper's model, generated."""
    folder = tmp_path / "project"
    (folder / "models").mkdir(parents=True)
    shutil.copy(root / "models" / "paper.toml", folder / "models")
    shutil.copytree(root / "generated" / "paper", folder / "generated" / "paper")
    return folder


def environment(root: Path, cache: Path) -> dict[str, str]:
    """The process's own environment with another cache."""
    return {**os.environ, "PMJOINT_CACHE": str(cache), "PYTHONPATH": str(root)}


def pmjoint(
    root: Path, project: Path, cache: Path, arguments: Sequence[str], largest_file: int | None = None
) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, perhaps on a disk that takes no file beyond some size."""

    def starve() -> None:
        if largest_file is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))

    return subprocess.run(
        [sys.executable, "-m", "pmjoint_codegen", *arguments],
        cwd=project,
        env=environment(root, cache),
        preexec_fn=starve,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def changed_gain(project: Path, gain: int) -> None:
    """Make the model say something else, so that there is something to write."""
    model = project / "models" / "paper.toml"
    text = model.read_text()
    start = text.index("c  = [")
    model.write_text(text[:start] + f"c  = [15, {gain}]" + text[text.index("]", start) + 1 :])


@pytest.mark.parametrize("delay", [0.3, 0.6, 0.8, 0.9, 1.0, 1.2])
def test_regenerate_killed_at_any_moment_leaves_a_whole_folder(
    root: Path, project: Path, tmp_path: Path, delay: float
) -> None:
    folder = project / "generated" / "paper"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    changed_gain(project, 16)
    command = [sys.executable, "-m", "pmjoint_codegen", "regenerate", "models/paper.toml"]
    child = subprocess.Popen(
        command, cwd=project, env=environment(root, tmp_path / "cache"), stdout=subprocess.DEVNULL
    )
    time.sleep(delay)
    child.send_signal(signal.SIGKILL)
    child.wait()
    left = {path.name: path.read_bytes() for path in folder.iterdir()} if folder.exists() else None
    regenerate([str(project / "models" / "paper.toml")])
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert left in (before, after, None)  # none for a moment between two renames
    assert before != after
    assert [path.name for path in (project / "generated").iterdir()] == ["paper"]


def test_a_disk_that_fills_up_while_building_leaves_nothing_broken(
    root: Path, project: Path, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    starved = pmjoint(root, project, cache, SHORT, largest_file=20_000)
    assert starved.returncode in (2, 3)
    assert "Traceback" not in starved.stderr and starved.stderr.strip()
    assert pmjoint(root, project, cache, SHORT).returncode == 0


def test_a_disk_that_fills_up_while_regenerating_leaves_the_old_folder(
    root: Path, project: Path, tmp_path: Path
) -> None:
    folder = project / "generated" / "paper"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    changed_gain(project, 16)
    starved = pmjoint(
        root, project, tmp_path / "cache", ["regenerate", "models/paper.toml"], largest_file=20_000
    )
    assert starved.returncode in (2, 3)
    assert "Traceback" not in starved.stderr and len(starved.stderr.splitlines()) == 1
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert pmjoint(root, project, tmp_path / "cache", ["regenerate", "models/paper.toml"]).returncode == 0


def test_results_that_do_not_fit_on_the_disk_are_one_line_and_3(
    root: Path, project: Path, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    assert pmjoint(root, project, cache, SHORT).returncode == 0
    out = project / "out"
    starved = pmjoint(root, project, cache, [*SHORT, "--out", str(out)], largest_file=1000)
    assert starved.returncode == 3
    assert "file too large" in starved.stderr and len(starved.stderr.splitlines()) == 1
    assert list(out.iterdir()) == []


def test_a_cache_that_cannot_be_written_is_replaced_and_said(
    root: Path, project: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("in the way")
    done = pmjoint(root, project, tmp_path / "file" / "cache", SHORT)
    assert done.returncode == 0
    assert "cannot be written" in done.stderr


def test_a_corrupted_cached_library_is_never_loaded(root: Path, project: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert pmjoint(root, project, cache, SHORT).returncode == 0
    (library,) = cache.rglob("*.so")
    for damage in (b"", b"not a library", library.read_bytes()[:-4096] + bytes(4096)):
        library.write_bytes(damage)  # loading any of these would end the process with a signal or an error
        assert pmjoint(root, project, cache, SHORT).returncode == 0
        assert library.read_bytes() != damage


def test_a_damaged_model_in_the_cache_is_derived_again(root: Path, project: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    command = [*SHORT, "--reference", "sin(2*t)"]
    assert pmjoint(root, project, cache, command).returncode == 0
    (folder,) = (cache / "models").iterdir()
    whole = {path.name: path.read_bytes() for path in folder.iterdir()}
    (folder / "sampled.h").unlink()
    assert pmjoint(root, project, cache, command).returncode == 0
    (folder / "kernels.c").write_bytes(whole["kernels.c"][:-9])
    done = pmjoint(root, project, cache, command)
    assert (done.returncode, done.stderr) == (0, "")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == whole


def test_eight_first_runs_at_once_share_one_build(root: Path, project: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    command = [sys.executable, "-m", "pmjoint_codegen", *SHORT]
    runs = [
        subprocess.Popen(
            [*command, "--out", str(tmp_path / f"run{i}")],
            cwd=project,
            env=environment(root, cache),
            stdout=subprocess.PIPE,
        )
        for i in range(8)
    ]
    outputs = [run.communicate(timeout=120)[0] for run in runs]
    assert [run.returncode for run in runs] == [0] * 8
    assert len(list(cache.rglob("*.so"))) == 1
    assert all(outputs)


def of_high_order(order: int) -> str:
    """Give a model file of n = rho = order, all poles of A0 at -5: order 7 derives for half a minute."""
    zeros = ", ".join(['["0"]'] * (order - 1))
    squares = ", ".join(['"y**2"'] * (order - 1))
    k = [math.comb(order, i) * 5**i for i in range(1, order + 1)]
    return f"""
schema = 1
name = "slow"
[parameters]
d1 = {{ value = 0.2 }}
b0 = {{ value = 2.0 }}
u_max = {{ value = 10.0 }}
[plant]
order = {order}
phi = ["sin(y)", {squares}]
Phi = [{zeros}, ["y"]]
theta = ["d1"]
b = ["b0"]
[actuator]
limit = "u_max"
[design]
c = {[2] * order}
e = {[0.1] * order}
ck = {[1] * order}
k = {k}
[simulation]
reference = "sin(t)"
x0 = {[0.1] + [0] * (order - 1)}
horizon = 1.0
"""


@pytest.mark.parametrize("command", ["regenerate", "simulate", "derive", "check"])
def test_a_long_derivation_names_its_stage_and_ends_at_once(
    root: Path, project: Path, tmp_path: Path, command: str
) -> None:
    """Ctrl-C in the middle: one more line, exit code 130, and no file of the model's."""
    (project / "models" / "slow.toml").write_text(of_high_order(7), encoding="utf-8")
    gates = ["--gate", "proof"] if command == "check" else []
    started = subprocess.Popen(
        [sys.executable, "-m", "pmjoint_codegen", command, "models/slow.toml", *gates],
        cwd=project,
        env={**environment(root, tmp_path / "cache"), "PMJOINT_PROGRESS": "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    told = []
    with started as child:
        assert child.stderr is not None
        for line in child.stderr:
            told.append(line.rstrip())
            if "partial derivatives of alpha_" in line:  # which of them is named depends on the machine
                break
        begun = time.monotonic()
        child.send_signal(signal.SIGINT)
        rest = child.stderr.read().splitlines()
    assert child.returncode == 130 and rest[-1] == "pmjoint: interrupted", (told, rest)
    assert time.monotonic() - begun < 10
    assert all(line.startswith("pmjoint: ") for line in (*told, *rest))
    left = ("models/paper.toml", "models/slow.toml", "generated/paper")
    assert {str(path.relative_to(project)) for path in project.glob("*/*")} <= {*left, "runs/slow"}
    assert list((project / "runs").rglob("*.*")) == []
    assert list((tmp_path / "cache").rglob("model.json")) == []
