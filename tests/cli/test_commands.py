"""The table of commands against the commands themselves."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import click
import pytest

from pmjoint_codegen.cli.commands import COMMANDS, CommandGroup, Entry
from pmjoint_codegen.cli.main import run


@pytest.mark.parametrize("entry", COMMANDS, ids=lambda entry: entry.name)
def test_each_entry_names_a_command_that_explains_itself(entry: Entry) -> None:
    command = import_module(entry.module).command
    assert isinstance(command, click.Command)
    assert command.name in (None, "command") or command.name == entry.name
    assert command.help
    assert entry.line.endswith(".")
    options = [parameter for parameter in command.params if isinstance(parameter, click.Option)]
    assert all(option.help for option in options)


def test_names_are_unique() -> None:
    assert len({entry.name for entry in COMMANDS}) == len(COMMANDS)


def test_commands_are_found_by_name_alone() -> None:
    group = CommandGroup(name="pmjoint", entries=COMMANDS)
    context = click.Context(group)
    assert group.list_commands(context) == [entry.name for entry in COMMANDS]
    assert group.get_command(context, "doctor") is import_module("pmjoint_codegen.cli.doctor").command
    assert group.get_command(context, "nothing") is None


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "paper", "--no-figures", "--out", ""),
        ("sweep", "paper", "--grid", "x1=0:1:2", "--no-figures", "--out", ""),
        ("tune", "paper", "--out", ""),
        ("audit", "--out", ""),
        ("new", "mine", "--out", ""),
        ("check", "paper", "--gate", "current", "--junit", ""),
    ],
    ids=lambda arguments: arguments[0],
)
def test_an_empty_path_is_refused_not_taken_for_the_current_folder(
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(arguments) == 2
    assert f"{arguments[-2]}': is empty" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["simulate", "sweep"])
@pytest.mark.parametrize("option", ["--reference", "--disturbance"])
def test_bytes_that_are_no_text_are_refused_in_expressions(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    varied = ("--grid", "x1=0:1:2") if command == "sweep" else ()
    assert run([command, "paper", option, "sin(t)\udcff", *varied, "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert option in said and "is not UTF-8" in said and len(said.splitlines()) == 1
