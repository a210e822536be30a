"""Each system of docs/gallery.md runs as its reader would run it, within its bounds, as the page says."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from docs import gallery
from pmjoint_codegen.workspace import known_models

SYSTEMS = gallery.systems()
by_system = pytest.mark.parametrize("system", SYSTEMS, ids=lambda system: system.model)


@by_system
def test_the_bare_command_reaches_its_horizon(system: gallery.System, root: Path, tmp_path: Path) -> None:
    file = f"{gallery.FOLDER}/{system.model}.toml"
    command = [
        sys.executable,
        "-m",
        "pmjoint_codegen",
        "simulate",
        file,
        "--no-figures",
        "--out",
        str(tmp_path),
    ]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=root)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr.lower()
    assert (tmp_path / "trajectory.csv").is_file()


@by_system
def test_every_run_is_within_its_bound_and_as_the_page_says(system: gallery.System) -> None:
    found = gallery.outcomes(system)
    assert [item.shown for item in found if not item.holds] == []
    text = gallery.PAGE.read_text(encoding="utf-8")
    assert gallery.section(system, found) in text
    assert gallery.line(system, found[0]) in text


@by_system
def test_nothing_is_eliminated_by_hand(system: gallery.System) -> None:
    keys = tomllib.loads(system.file.read_text(encoding="utf-8")).keys()
    assert len(keys & {"joint", "system"}) == 1
    assert "plant" not in keys


def test_files_figures_and_page_are_those_of_the_list() -> None:
    names = [system.model for system in SYSTEMS]
    assert sorted(file.stem for file in (gallery.ROOT / gallery.FOLDER).iterdir()) == sorted(names)
    assert sorted(file.stem for file in gallery.FIGURES.iterdir()) == sorted(names)
    head, *sections = gallery.PAGE.read_text(encoding="utf-8").split("\n## ")
    assert head.startswith(gallery.HEAD)
    assert [section.partition("\n")[0] for section in sections] == [system.title for system in SYSTEMS]
    assert head.count("](#") == len(names)


def test_commands_over_all_models_leave_the_gallery_alone(root: Path) -> None:
    names = {system.model for system in SYSTEMS}
    assert names.isdisjoint(known_models(root))
    assert names.isdisjoint(folder.name for folder in (root / "generated").iterdir())


def test_a_run_that_misses_its_bound_is_seen() -> None:
    system = SYSTEMS[0]
    found = gallery.outcome(system, system.runs[0])
    assert found.holds and found.late is not None
    run = found.run
    assert not replace(found, run=replace(run, bound=found.late / 2)).holds
    assert not replace(found, run=replace(run, bound=None)).holds
    assert not replace(found, late=None).holds
    assert replace(found, run=replace(run, bound=None), late=None).holds


def test_a_command_that_fails_is_no_lost_loop() -> None:
    system = SYSTEMS[0]
    with pytest.raises(SystemExit, match="no-such"):
        gallery.outcome(system, replace(system.runs[0], options="--no-such"))


@pytest.mark.parametrize("bound", [0.0, -1.0, float("inf"), float("nan")])
def test_a_bound_that_proves_nothing_is_refused(bound: float) -> None:
    with pytest.raises(ValueError, match="positive"):
        replace(SYSTEMS[0].runs[0], bound=bound)
