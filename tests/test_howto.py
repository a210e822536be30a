"""Each diff of docs/howto/change-the-model.md applies to the file it names, and the result simulates."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from docs import story
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.simulate.run import Run

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "howto" / "change-the-model.md").read_text(encoding="utf-8")
DIFFS: list[tuple[str, str]] = re.findall(
    r"<!-- applies to (models/[\w-]+\.toml) -->\n```diff\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE
)


def applied(file: str, diff: str, folder: Path) -> Path:
    """A changed copy of a model file."""
    path = folder / Path(file).name
    path.write_text(story.applied((ROOT / file).read_text(encoding="utf-8"), diff), encoding="utf-8")
    return path


def simulated(file: str, diff: str, folder: Path) -> Run:
    """Derive and simulate a changed model."""
    return ClosedLoop.load(applied(file, diff, folder), "interpreted").simulate(horizon=4.0)


def test_every_change_has_a_diff() -> None:
    assert len(DIFFS) == 4
    assert PAGE.count("\n```diff\n") == len(DIFFS) + len(list(story.models())) - 1
    assert len(re.findall(r"^## (?:My joint has|I have)", PAGE, re.MULTILINE)) == 3
    for _, diff in DIFFS:
        assert all(line[:1] in "+-" for line in diff.splitlines())


@pytest.mark.parametrize(("file", "diff"), DIFFS, ids=[f"{file}-{i}" for i, (file, _) in enumerate(DIFFS)])
def test_a_changed_model_simulates_and_tracks(file: str, diff: str, tmp_path: Path) -> None:
    run = simulated(file, diff, tmp_path)
    assert run.summary["status"] == "done"
    late = run.t > 2.0
    if "paper" not in file:  # whose compensator is slow
        assert abs(run["e"][late]).max() < 0.05 * abs(run["y_r"]).max()
    muscles = run.summary["pressures"]
    assert muscles is None or not any(item["clipped"] for item in muscles.values())


def test_keeping_the_damping_leaves_less_to_the_disturbance(tmp_path: Path) -> None:
    file, diff = DIFFS[0]
    before = ClosedLoop.load(ROOT / file).simulate(horizon=4.0)
    assert simulated(file, diff, tmp_path).summary["disturbance_max"] < before.summary["disturbance_max"]


TABLE: dict[str, float] = {
    name: float(value) for name, value in re.findall(r"^\| ([^|]+?) \| ([\d.]+)° \|$", PAGE, re.MULTILINE)
}
STORY = dict(story.models())


def late_error(run: Run) -> float:
    """Largest |e| for t > 1 s, in degrees."""
    assert run.summary["status"] == "done" and run.summary["sample_time"] == 0.01
    return float(np.degrees(np.max(np.abs(run["e"][run.t > 1.0]))))


def test_the_table_has_a_row_for_every_step() -> None:
    assert list(TABLE) == [*STORY, "gait"]


@pytest.mark.parametrize("name", STORY)
def test_a_step_of_the_story_tracks_as_the_table_says(name: str, tmp_path: Path) -> None:
    file = tmp_path / "forearm.toml"
    file.write_text(STORY[name], encoding="utf-8")
    run = ClosedLoop.load(file, "interpreted", notify=lambda line: None).simulate()
    assert late_error(run) == pytest.approx(TABLE[name], rel=5e-3)
    if name == "friction":
        assert run.summary["stuck_s"] > 0.1


def test_the_recorded_gait_runs_as_its_command_says(tmp_path: Path) -> None:
    assert f"\npmjoint simulate forearm {story.GAIT}\n" in PAGE
    (tmp_path / "gait.csv").write_text(story.gait(), encoding="utf-8")
    (tmp_path / "forearm.toml").write_text(STORY["friction"], encoding="utf-8")
    data = {"file": str(tmp_path / "gait.csv"), "unit": "deg", "filter": 15}
    loop = ClosedLoop.load(tmp_path / "forearm.toml", "interpreted", reference=data, notify=lambda line: None)
    assert late_error(loop.simulate(horizon=7.0)) == pytest.approx(TABLE["gait"], rel=5e-3)
