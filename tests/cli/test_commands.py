"""The table of commands against the commands themselves."""

from __future__ import annotations

from importlib import import_module

import click
import pytest

from pmjoint_codegen.cli.commands import COMMANDS, CommandGroup, Entry


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
