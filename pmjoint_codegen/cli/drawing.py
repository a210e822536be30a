"""Prepares Matplotlib for a command: its folder, its backend, an error if its settings are unreadable."""

from __future__ import annotations

import os

from pmjoint_codegen.errors import UsageError


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
