"""Each diff of docs/howto/change-the-model.md applies to the file it names, and the result simulates."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.simulate.run import Run

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "howto" / "change-the-model.md").read_text(encoding="utf-8")
DIFFS: list[tuple[str, str]] = re.findall(
    r"<!-- applies to (models/[\w-]+\.toml) -->\n```diff\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE
)


def applied(file: str, diff: str, folder: Path) -> Path:
    """Apply a diff without context to a copy of a model file: - lines give way to the + lines below."""
    text = (ROOT / file).read_text(encoding="utf-8")
    for old, new in re.findall(r"((?:^-.*\n)+)((?:^\+.*\n)+)", diff, re.MULTILINE):
        removed, added = (re.sub(r"^[-+]", "", block, flags=re.MULTILINE) for block in (old, new))
        assert text.count(removed) == 1, removed
        text = text.replace(removed, added)
    path = folder / Path(file).name
    path.write_text(text, encoding="utf-8")
    return path


def simulated(file: str, diff: str, folder: Path) -> Run:
    """Derive and simulate a changed model."""
    return ClosedLoop.load(applied(file, diff, folder), "interpreted").simulate(horizon=4.0)


def test_every_change_has_a_diff() -> None:
    assert PAGE.count("\n```diff\n") == len(DIFFS) == 6
    assert len(re.findall(r"^## (?:My joint has|I have)", PAGE, re.MULTILINE)) == 4
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
