"""The ``pmjoint`` command, and the one place that turns an error into a line and an exit code.

    0    done
    1    a check found a difference
    2    bad usage or bad model
    3    a run failed: diverged, compiler failed, disk full
    129  the terminal was closed (SIGHUP)
    130  interrupted from the keyboard
    143  terminated (SIGTERM)

Messages go to standard error. Where that is closed or full they are lost, and the exit code stays. A standard
output that nobody reads (a closed pipe or descriptor) is no error; one that cannot be written gives 3.
``PMJOINT_TRACEBACK=1`` shows where an error came from.

This module imports next to nothing. So `main` handles Ctrl-C even while other modules are being imported.
"""

from __future__ import annotations

import os
import sys

from pmjoint_codegen.cli import streams

TYPE_CHECKING = False  # as in `typing`, which is slow to import

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

    import click

    from pmjoint_codegen.cli.commands import CommandGroup

_HELP = """Derive, generate, compile and simulate the controller of a saturated pneumatic muscle joint.

A MODEL is the name of a file in models/ (such as paper) or the path of a model file.

\b
Start with
  pmjoint simulate paper            run the paper's example; look in runs/paper/
  pmjoint simulate paper --help     see what can be changed from the command line

\b
Exit codes
  0 done                    1 a check found a difference
  2 bad usage or model      3 a run failed, or a resource ran out
  130, 143, 129             ended by Ctrl-C, SIGTERM, a closed terminal
"""

_LONGEST = 1000  # characters of a message

_BRINGS = {  # module -> what installs it
    **dict.fromkeys(("sympy", "mpmath", "casadi", "pint", "pydantic"), "pmjoint-codegen[derive]"),
    **dict.fromkeys(("xarray", "zarr", "pandas", "pyarrow", "h5netcdf"), "pmjoint-codegen[sweep]"),
    "mcap": "pmjoint-codegen[logs]",
    "_cffi_backend": "cffi",
    "matplotlib": "matplotlib",
    "plotext": "pmjoint-codegen[terminal]",
    "scipy": "scipy",
}


class Terminated(KeyboardInterrupt):
    """The system ends the process. What cleans up after Ctrl-C also cleans up after this.

    Attributes:
        signal: its number.
    """

    def __init__(self, signal: int) -> None:
        super().__init__(signal)
        self.signal = signal


def main() -> None:
    """Run the command that the process was started with, and exit."""
    try:
        streams.open_missing()
        _listen()
        code = run(sys.argv[1:])
        streams.settle()
    except KeyboardInterrupt as stop:
        code = _stopped(stop)
    _stop_listening()
    sys.exit(code)


def _listen() -> None:
    """Turn the signals that end a process into an exception, so that nothing is left behind."""
    import signal

    def stop(number: int, _frame: FrameType | None) -> None:
        raise Terminated(number)

    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # else the caller, such as nohup, ignores it
            signal.signal(number, stop)


def _stop_listening() -> None:
    """Restore the default signals: the interpreter is about to end and can handle no more exceptions."""
    import signal

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)


def run(arguments: Sequence[str]) -> int:
    """Run one command line.

    Args:
        arguments: what follows ``pmjoint``.

    Returns:
        the exit code. Only exceptions that end an interpreter leave this function.
    """
    try:
        return _with_click(list(arguments))
    except KeyboardInterrupt as stop:
        return _stopped(stop)
    except Exception as error:  # the boundary: every error becomes a line and a code here
        behind = _interruption(error)
        return _report(error) if behind is None else _stopped(behind)


def _with_click(arguments: list[str]) -> int:
    """Run a command line; what click raises becomes a line and a code here."""
    import click

    from pmjoint_codegen.cli.terminal import message

    try:
        return _invoke(arguments)
    except click.exceptions.Exit as stop:
        return int(stop.exit_code)
    except click.exceptions.NoArgsIsHelpError as bare:
        message(bare.format_message())
        return 2
    except click.ClickException as misuse:
        message(_usage_line(misuse))
        return 2
    except click.Abort as abort:
        raise KeyboardInterrupt from abort


def _invoke(arguments: list[str]) -> int:
    group = program()
    if "_PMJOINT_COMPLETE" in os.environ:  # the shell requests completions
        group.main(arguments, prog_name="pmjoint")
    with group.make_context("pmjoint", arguments, obj=tuple(arguments)) as context:  # for a run's record
        code = group.invoke(context)
    return code if isinstance(code, int) else 0


def program() -> CommandGroup:
    """Make the command group."""
    import click

    from pmjoint_codegen.cli.commands import COMMANDS, CommandGroup

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


def _version(ctx: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """Print the version and stop."""
    from pmjoint_codegen import __version__
    from pmjoint_codegen.cli.terminal import result

    if wanted and not ctx.resilient_parsing:
        result(f"pmjoint {__version__}")
        ctx.exit()


def _interruption(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interruption behind an error: a library may turn one during its import into an error of its own."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        if isinstance(error, KeyboardInterrupt):
            return error
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return None


def _stopped(stop: KeyboardInterrupt) -> int:
    """Print that the command was stopped, and give the exit code that shells use."""
    number = stop.signal if isinstance(stop, Terminated) else 2  # SIGINT
    words = {2: "interrupted", 1: "the terminal was closed"}.get(number, "terminated")
    try:
        if sys.stderr is not None:
            print(f"pmjoint: {words}", file=sys.stderr, flush=True)  # without an import
    except OSError:
        pass
    return 128 + number


def _usage_line(misuse: click.ClickException) -> str:
    """State in one line what is wrong with a command line and where its help is."""
    import click

    context = misuse.ctx if isinstance(misuse, click.UsageError) else None
    path = context.command_path if context else "pmjoint"
    what = " ".join(misuse.format_message().split()).rstrip(".")
    return f"{path}: {_cut(what[:1].lower() + what[1:])}; see {path} --help"


def _cut(line: str) -> str:
    """Cut the middle out of a line that repeats overlong input."""
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"


def _report(error: Exception) -> int:
    """Print an error as one line, after the compiler's output if there is any, and give its exit code."""
    from pmjoint_codegen.cli.terminal import message
    from pmjoint_codegen.errors import BuildError, PmjointError, installing

    if isinstance(error, BrokenPipeError) and streams.reader_left():
        return 0
    if os.environ.get("PMJOINT_TRACEBACK") == "1":
        import traceback

        traceback.print_exception(error)
    if isinstance(error, PmjointError):
        if isinstance(error, BuildError) and error.output:
            message(error.output.rstrip())
        message(f"pmjoint: {_cut(str(error))}")
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
        f"pmjoint: unexpected {kind}: {what}; a bug: please report it with the output of PMJOINT_TRACEBACK=1"
    )
    return 3
