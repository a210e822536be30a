"""Value types of options, and what several commands share."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from pmjoint_codegen.cli.terminal import message

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from pmjoint_codegen.manifest import Manifest
    from pmjoint_codegen.simulate.settings import CommandOptions

    _Kind = click.ParamType[Any]  # generic in newer releases of click, for the type checker only
else:
    _Kind = click.ParamType


class Assignment(_Kind):
    """``NAME=VALUE`` with a number for VALUE."""

    name = "NAME=VALUE"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """Split at the equals sign; refuse what is not a name and a number."""
        if isinstance(value, tuple):
            return value
        name, sign, number = str(value).partition("=")
        if not sign or not name.strip():
            self.fail(f"{value!r} is not NAME=VALUE, such as c1=20", param, ctx)
        return name.strip(), number_of(number, self, param, ctx)


class Place(click.Path):
    """A path to write to, as a `Path`; an empty one, as from an unset shell variable, is a mistake."""

    def __init__(self, *, dir_okay: bool = True) -> None:
        """Take click's setting: whether the path may be a folder."""
        super().__init__(dir_okay=dir_okay, path_type=Path)

    def convert(
        self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """Refuse the empty path, which would mean the current folder or a silent default."""
        if os.fspath(value) == "":
            self.fail("is empty; give a path, or omit the option", param, ctx)
        return super().convert(value, param, ctx)


class ModelName(_Kind):
    """A model by name or path, with shell completion."""

    name = "model"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Take it as it is: the command finds the file, or lists the known models."""
        return str(value)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Give matching names of models and model files; if none match, the shell completes file names."""
        from click.shell_completion import CompletionItem

        from pmjoint_codegen.workspace import known_models

        folder = os.path.dirname(incomplete)
        files = sorted(file for file in Path(folder).glob("[!.]*.toml") if file.is_file())
        paths = (os.path.join(folder, file.name) for file in files)
        found = [text for text in (*known_models(), *paths) if text.startswith(incomplete)]
        return [CompletionItem(text) for text in found] or [CompletionItem(incomplete, type="file")]


class Numbers(_Kind):
    """Numbers separated by commas, such as ``1.5,0``; not by name, which is what ``--set`` takes."""

    name = "A,B,..."

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Split at commas; refuse what is not a number."""
        if isinstance(value, tuple):
            return value
        if "=" in str(value):
            what = "takes numbers in the order of the states, without names"
            self.fail(f"{value!r} {what}; --set NAME=VALUE sets a parameter or a gain", param, ctx)
        return tuple(number_of(text, self, param, ctx) for text in str(value).split(","))


def number_of(text: str, kind: _Kind, param: click.Parameter | None, ctx: click.Context | None) -> float:
    """Read a number, or fail as click does."""
    try:
        return float(text)
    except ValueError:
        kind.fail(f"{text.strip()!r} is not a number", param, ctx)


def assignments(
    ctx: click.Context, param: click.Parameter, pairs: tuple[tuple[str, float], ...]
) -> dict[str, float]:
    """Gather assignments; a name that is set twice is a mistake."""
    table: dict[str, float] = {}
    for name, value in pairs:
        if name in table:
            raise click.BadParameter(f"{name} is set twice", ctx=ctx, param=param)
        table[name] = value
    return table


def tell_clock(asked: CommandOptions, manifest: Manifest) -> None:
    """Warn of what has no effect under a controller without a clock: a sample time, keys of the model."""
    from pmjoint_codegen.simulate.settings import default_controller, left_out

    if (asked["controller"] or default_controller(manifest)) == "sampled":
        return
    if asked["sample_time"] is not None:
        message("pmjoint: --sample-time has no effect without --controller sampled")
    keys = left_out(manifest, "continuous")
    if keys:
        message(f"pmjoint: the continuous controller has no clock and leaves out: {', '.join(keys)}")


def check_saturation(saturation: str | None, asked: CommandOptions) -> None:
    """Refuse two options that contradict each other."""
    if saturation not in (None, "clip") and asked["compensator"] is False:
        raise click.UsageError(f"--no-compensator contradicts --saturation {saturation}")


def tell_design(manifest: Manifest, warning: str | None = None) -> None:
    """Say what keys of the design came to, and a warning, such as of a law that is too fast for its clock."""
    for line in filter(None, (*manifest.chosen, warning)):
        message(f"pmjoint: {line}")


_DATA_FILES: Final = (".csv", ".tsv", ".txt")
_OF_DATA: Final[Mapping[str, tuple[str, Mapping[str, Any]]]] = {
    "time": (
        "--reference-time",
        {"metavar": "NAME", "help": "Its column of time [default: the first]."},
    ),
    "column": ("--reference-column", {"metavar": "NAME", "help": "Column of y_r [default: the next]."}),
    "unit": ("--reference-unit", {"metavar": "UNIT", "help": "Its unit, such as deg [default: y's]."}),
    "filter": (
        "--reference-filter",
        {
            "type": float,
            "metavar": "A",
            "help": "Filter it by (A/(s + A))^(rho + 1), A in 1/s [default: none, a smooth spline].",
        },
    ),
}


def _keep(ctx: click.Context, param: click.Parameter, value: Any) -> None:
    """Keep an option of a reference's file for `_reference`, which is called later."""
    ctx.meta[f"{__name__}.{param.name}"] = value


def _reference(ctx: click.Context, param: click.Parameter, value: str | None) -> str | dict[str, Any] | None:
    """An expression as text, or a file with the options that belong to it as a model file has them."""
    kept = {key: ctx.meta.get(f"{__name__}.reference_{key}") for key in _OF_DATA}
    given = {key: item for key, item in kept.items() if item is not None}
    if value is not None and value.lower().endswith(_DATA_FILES):
        return {"file": value, **given}
    if given:
        option = _OF_DATA[next(iter(given))][0]
        raise click.BadParameter(f"{option} belongs to a .csv file", ctx=ctx, param=param)
    return value


# One option per keyword of a run. A command replaces the help text where its option means more.
_OF_A_RUN: Final[Mapping[str, tuple[str, Mapping[str, Any]]]] = {
    "parameters": ("--set", {"type": Assignment(), "multiple": True, "callback": assignments}),
    "x0": ("--x0", {"type": Numbers(), "help": "Initial plant states."}),
    "reference": (
        "--reference",
        {
            "metavar": "EXPR|FILE",
            "callback": _reference,
            "help": "Another y_r: a function of t and parameters, or a .csv file with columns t and y.",
        },
    ),
    "disturbance": (
        "--disturbance",
        {"metavar": "EXPR", "multiple": True, "help": "Another disturbance; repeat it, one per state."},
    ),
    "horizon": ("--horizon", {"type": float, "metavar": "S", "help": "Length of every run in seconds."}),
    "output_step": (
        "--output-step",
        {"type": float, "metavar": "S", "help": "Time between output instants in seconds."},
    ),
    "controller": (
        "--controller",
        {
            "type": click.Choice(["continuous", "sampled"]),
            "help": "continuous: as in the paper; sampled: as on a microcontroller, with v constant between "
            "samples [default: continuous, or sampled where the model has a sensor or a clock].",
        },
    ),
    "sample_time": (
        "--sample-time",
        {"type": float, "metavar": "S", "help": "Sample time of the sampled controller in seconds."},
    ),
    "start": (
        "--start",
        {
            "type": click.Choice(["zero", "matched"]),
            "help": "Where filters and compensator start: at 0, or matched to y(0), so that the error begins "
            "without a kick [default: the model's].",
        },
    ),
    "saturation": (
        "--saturation",
        {
            "type": click.Choice(["compensator", "clip", "braking"]),
            "help": "What to do about a saturated input: (23), r = 0, or a compensator that brakes as the "
            "limit allows, for relative degree 2 [default: the model's].",
        },
    ),
    "compensator": (
        "--no-compensator",
        {
            "is_flag": True,
            "callback": lambda context, option, given: False if given else None,
            "help": "The same as --saturation clip.",
        },
    ),
    "tolerance": (
        "--tolerance",
        {"type": float, "metavar": "TOL", "show_default": True, "help": "Local error tolerance."},
    ),
    "max_step": (
        "--max-step",
        {"type": float, "metavar": "S", "help": "Longest integration step in seconds."},
    ),
    "divergence": (
        "--divergence",
        {
            "type": float,
            "metavar": "X",
            "help": "A state beyond this limit ends a run "
            "[default: 1e4, more for pressures in Pa, a distant start, order 3 or more, or a small b_m].",
        },
    ),
}


def run_options(**changes: Mapping[str, Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command options of a run.

    Args:
        changes: keyword -> settings of its option in this command, such as a default, that replace the common
            ones; ``--help`` lists the options in this order.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for keyword, changed in reversed(changes.items()):
            option, common = _OF_A_RUN[keyword]
            for key, (name, settings) in reversed(list(_OF_DATA.items()) if keyword == "reference" else []):
                kept: dict[str, Any] = {
                    "is_eager": True,
                    "expose_value": False,
                    "callback": _keep,
                    **settings,
                }
                command = click.option(name, f"reference_{key}", **kept)(command)
            command = click.option(option, keyword, **{**common, **changed})(command)
        return command

    return decorate
