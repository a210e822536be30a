"""The ``pmjoint`` command, and the one place where an error becomes a line and an exit code.

    0    done
    1    a check found a difference
    2    bad usage or bad model
    3    a run failed: diverged, compiler failed, disk full
    130  interrupted from the keyboard

Messages go to standard error. ``PMJOINT_TRACEBACK=1`` shows where an error came from.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import click

from pmjoint_codegen import __version__
from pmjoint_codegen.cli.commands import COMMANDS, CommandGroup
from pmjoint_codegen.cli.terminal import message, settle_output
from pmjoint_codegen.errors import BuildError, PmjointError, installing

_HELP = """Derive, generate, compile and simulate the controller of a saturated pneumatic muscle joint.

A MODEL is the name of a file in models/ (such as paper) or the path of a model file.

\b
Start with
  pmjoint simulate paper            run the paper's example; look in runs/paper/
  pmjoint simulate paper --help     see what can be changed from the command line
"""

_BRINGS = {  # module -> what brings it
    **dict.fromkeys(("sympy", "mpmath", "casadi", "pint", "pydantic"), "pmjoint-codegen[derive]"),
    **dict.fromkeys(("xarray", "zarr", "pandas", "pyarrow", "h5netcdf"), "pmjoint-codegen[sweep]"),
    "_cffi_backend": "cffi",
    "matplotlib": "matplotlib",
    "scipy": "scipy",
}


def _version(ctx: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """Print the version and stop."""
    if wanted and not ctx.resilient_parsing:
        click.echo(f"pmjoint {__version__}")
        ctx.exit()


def program() -> CommandGroup:
    """Make the command group."""
    version = click.Option(
        ["--version"],
        is_flag=True,
        expose_value=False,
        is_eager=True,
        callback=_version,
        help="Show the version and exit.",
    )
    return CommandGroup(
        name="pmjoint",
        entries=COMMANDS,
        help=_HELP,
        params=[version],
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    )


def main() -> None:
    """Run the command that the process was started with, and exit."""
    code = run(sys.argv[1:])
    settle_output()
    sys.exit(code)


def run(arguments: Sequence[str]) -> int:
    """Run one command line.

    Args:
        arguments: what follows ``pmjoint``.

    Returns:
        the exit code. No exception leaves this function but those that end an interpreter.
    """
    try:
        return _invoke(list(arguments))
    except click.exceptions.Exit as stop:
        return int(stop.exit_code)
    except click.exceptions.NoArgsIsHelpError as bare:
        message(bare.format_message())
        return 2
    except click.ClickException as misuse:
        message(_usage_line(misuse))
        return 2
    except (KeyboardInterrupt, click.Abort):
        message("pmjoint: interrupted")
        return 130
    except Exception as error:  # the boundary: nothing but a line and a code goes on from here
        return _report(error)


def _invoke(arguments: list[str]) -> int:
    group = program()
    if "_PMJOINT_COMPLETE" in os.environ:  # the shell asks for completions
        group.main(arguments, prog_name="pmjoint")
    with group.make_context("pmjoint", arguments) as context:
        code = group.invoke(context)
    return code if isinstance(code, int) else 0


def _usage_line(misuse: click.ClickException) -> str:
    """Say in one line what is wrong with a command line and where its help is."""
    context = misuse.ctx if isinstance(misuse, click.UsageError) else None
    path = context.command_path if context else "pmjoint"
    what = " ".join(misuse.format_message().split()).rstrip(".")
    return f"{path}: {what[:1].lower()}{what[1:]}; see {path} --help"


def _report(error: Exception) -> int:
    """Print an error as one line, after the compiler's words if it has any, and give its exit code."""
    if os.environ.get("PMJOINT_TRACEBACK") == "1":
        import traceback

        traceback.print_exception(error)
    if isinstance(error, PmjointError):
        if isinstance(error, BuildError) and error.output:
            message(error.output.rstrip())
        message(f"pmjoint: {error}")
        return error.exit_code
    if isinstance(error, ModuleNotFoundError) and error.name in _BRINGS:
        line = installing(_BRINGS[error.name])
        message(f"pmjoint: needs {error.name}, which is not installed; install it: {line}")
        return 3
    if isinstance(error, OSError) and error.strerror:
        place = f"{error.filename}: " if error.filename else ""
        message(f"pmjoint: {place}{error.strerror}")
        return 3
    kind = type(error).__name__
    what = " ".join(str(error).split())
    message(
        f"pmjoint: unexpected {kind}: {what}; a bug: please report it with what PMJOINT_TRACEBACK=1 shows"
    )
    return 3
