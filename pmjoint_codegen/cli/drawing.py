"""What commands that draw share: options of figures, and Matplotlib's folder, backend and settings."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Final

import click

from pmjoint_codegen.errors import UsageError

FIGURE_FORMATS: Final = ("png", "pdf", "svg")  # the default first


def page_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of the page that figures are drawn for."""
    for option in reversed(
        (
            click.option("--no-caption", is_flag=True, help="Draw figures without captions."),
            click.option(
                "--style",
                type=click.Choice(["paper", "slides"]),
                default="paper",
                help="Of figures: slides have larger text and heavier lines.",
            ),
            click.option(
                "--width",
                metavar="WIDTH",
                help="Of figures: a length, such as 120mm or 5in, or ieee (3.5in), ieee-wide (7.16in),"
                " elsevier (90mm), elsevier-wide (190mm) [default: 6.3in, slides 10in].",
            ),
        )
    ):
        command = option(command)
    return command


def kinds_of(formats: tuple[str, ...]) -> tuple[str, ...]:
    """The formats of figures among those asked for, or the default."""
    return tuple(name for name in FIGURE_FORMATS if name in formats) or FIGURE_FORMATS[:1]


def ready_matplotlib() -> None:
    """Prepare this process, which runs one command only, to draw into files.

    Raises:
        UsageError: a ``matplotlibrc`` that Matplotlib reads is not text.
    """
    from pmjoint_codegen.workspace import cache_dir

    # Matplotlib keeps its list of fonts under HOME, and complains where that cannot be written.
    os.environ.setdefault("MPLCONFIGDIR", str(cache_dir(os.environ) / "matplotlib"))
    os.environ["MPLBACKEND"] = "agg"  # notebooks export one that exists only inside them
    try:
        import matplotlib  # noqa: F401
    except UnicodeDecodeError as error:
        raise UsageError(
            "is not UTF-8, so no figure can be drawn",
            where="the matplotlibrc in use (here, MATPLOTLIBRC or Matplotlib's own folder)",
            remedy="fix or remove it, or use --no-figures",
        ) from error
