"""Models completed by the shell: names and model files, through the way that each shell takes."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.shell_completion import get_completion_class

from pmjoint_codegen.cli.main import program

WITH_MODELS = ("simulate", "sweep", "tune", "derive", "check", "regenerate")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current folder with models of the user's own."""
    for name in (
        "models/elbow.toml",
        "other/knee.toml",
        "kite.toml",
        "other/notes.txt",
        "other/.hidden.toml",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def completed(shell: str, arguments: list[str], incomplete: str) -> list[tuple[str, str]]:
    """Kind and text of what a shell is offered."""
    kind = get_completion_class(shell)
    assert kind is not None
    completion = kind(program(), {}, "pmjoint", "_PMJOINT_COMPLETE")
    assert "_PMJOINT_COMPLETE" in completion.source_template or "complete_var" in completion.source_template
    return [(item.type, item.value) for item in completion.get_completions(arguments, incomplete)]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_names_of_models_are_offered(shell: str, here: Path) -> None:
    offered = completed(shell, ["simulate"], "")
    assert {("plain", "paper"), ("plain", "elbow"), ("plain", "kite.toml")} <= set(offered)
    assert completed(shell, ["simulate"], "pa") == [("plain", "paper"), ("plain", "paper-adaptive")]


@pytest.mark.parametrize("command", WITH_MODELS)
def test_every_command_that_takes_a_model_completes_it(command: str, here: Path) -> None:
    assert completed("bash", [command], "third") == [("plain", "third-order")]


def test_model_files_are_offered_in_folders_and_nothing_else(here: Path) -> None:
    assert completed("bash", ["simulate"], "other/") == [("plain", "other/knee.toml")]
    assert completed("bash", ["simulate"], f"{here}/other/k") == [("plain", f"{here}/other/knee.toml")]


def test_folders_are_left_to_the_shell(here: Path) -> None:
    assert completed("bash", ["simulate"], "oth") == [("file", "oth")]
    assert completed("bash", ["simulate"], "no/such/") == [("file", "no/such/")]


def test_commands_choices_and_options_are_completed(here: Path) -> None:
    assert ("plain", "simulate") in completed("bash", [], "sim")
    assert completed("bash", ["simulate", "paper", "--controller"], "s") == [("plain", "sampled")]
    assert ("plain", "--horizon") in completed("bash", ["simulate", "paper"], "--hor")
