"""The table of commands, and a click group that imports a command's module only when needed.

Help lists every command with its line from the table, so ``pmjoint --help`` imports none of them either.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

import click


@dataclass(frozen=True)
class Entry:
    """One command: its name, the module that holds it as ``command``, its line in the list of commands."""

    name: str
    module: str
    line: str


COMMANDS = (
    Entry(
        "simulate",
        "pmjoint_codegen.cli.simulate",
        "Integrate the closed loop; write trajectory, summary, figures.",
    ),
    Entry(
        "plot",
        "pmjoint_codegen.cli.plot",
        "Redraw a run from its folder, or compare several.",
    ),
    Entry(
        "sweep",
        "pmjoint_codegen.cli.sweep",
        "Simulate over grids and random draws; write data and maps.",
    ),
    Entry(
        "tune",
        "pmjoint_codegen.cli.tune",
        "Choose the best gains within limits.",
    ),
    Entry("derive", "pmjoint_codegen.cli.derive", "Print the derivation of a model, equation by equation."),
    Entry(
        "regenerate",
        "pmjoint_codegen.cli.regenerate",
        "Write generated/<model>/, or with --check say what is stale.",
    ),
    Entry(
        "diff",
        "pmjoint_codegen.cli.diff",
        "Show what a change of a model changes since a revision of git.",
    ),
    Entry(
        "check",
        "pmjoint_codegen.cli.check",
        "Check generated code against the derivation, gate by gate.",
    ),
    Entry(
        "audit",
        "pmjoint_codegen.cli.audit",
        "Check the paper's equations against what follows from its model.",
    ),
    Entry(
        "export",
        "pmjoint_codegen.cli.export",
        "Write the controller as C for another tool chain.",
    ),
    Entry(
        "report",
        "pmjoint_codegen.cli.report",
        "Write a page with a model's derivation, proof, checks and runs.",
    ),
    Entry(
        "explorer",
        "pmjoint_codegen.cli.explorer",
        "Write a page that runs the closed loop in a browser.",
    ),
    Entry("new", "pmjoint_codegen.cli.new", "Write a commented model file that simulates at once."),
    Entry(
        "doctor",
        "pmjoint_codegen.cli.doctor",
        "Show this machine's compiler and tools, and what that means.",
    ),
)


class CommandGroup(click.Group):
    """A group whose commands come from a table and are imported on demand."""

    def __init__(self, *, entries: tuple[Entry, ...], **settings: object) -> None:
        """Take the table; ``settings`` are click's own (name, help, params, context_settings)."""
        super().__init__(**settings)  # type: ignore[arg-type]  # click types each setting separately
        self.entries = {entry.name: entry for entry in entries}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Name the commands in the order of the table."""
        return list(self.entries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one command, or give None for a name that is not in the table."""
        entry = self.entries.get(cmd_name)
        if entry is None:
            return None
        command: click.Command = import_module(entry.module).command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that the arguments name, or list the commands."""
        if args and args[0] not in self.entries and not args[0].startswith("-"):
            ctx.fail(f"no command {args[0]!r}; there are {', '.join(self.entries)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands from the table."""
        with formatter.section("Commands"):
            formatter.write_dl([(entry.name, entry.line) for entry in self.entries.values()])
