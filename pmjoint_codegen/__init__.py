"""Derives, generates, compiles and simulates controllers of saturated pneumatic muscle joints.

    from pmjoint_codegen import ClosedLoop

    run = ClosedLoop.load("paper").simulate(horizon=20.0, parameters={"c1": 20.0})
    run.t, run["x1"], run.summary

Importing the package imports nothing else: a public name is imported on first use.
"""

from __future__ import annotations

TYPE_CHECKING = False  # `typing` costs milliseconds, in which Ctrl-C would end in a traceback

if TYPE_CHECKING:
    from pmjoint_codegen.closed_loop import ClosedLoop
    from pmjoint_codegen.errors import (
        BuildError,
        CheckFailed,
        MissingToolError,
        ModelError,
        PmjointError,
        SimulationError,
        StaleError,
        UsageError,
    )
    from pmjoint_codegen.simulate.compare import compare
    from pmjoint_codegen.simulate.folder import open_run
    from pmjoint_codegen.simulate.run import Run
    from pmjoint_codegen.studies.sweep import sweep
    from pmjoint_codegen.studies.tune import Tuned, tune

__version__ = "0.1.0"

__all__ = [
    "BuildError",
    "CheckFailed",
    "ClosedLoop",
    "MissingToolError",
    "ModelError",
    "PmjointError",
    "Run",
    "SimulationError",
    "StaleError",
    "Tuned",
    "UsageError",
    "__version__",
    "compare",
    "open_run",
    "sweep",
    "tune",
]


def _home(name: str) -> str | None:
    """Name the module that defines a public name, or None for a name that is not public."""
    if name == "ClosedLoop":
        return "pmjoint_codegen.closed_loop"
    if name == "compare":
        return "pmjoint_codegen.simulate.compare"
    if name == "open_run":
        return "pmjoint_codegen.simulate.folder"
    if name == "Run":
        return "pmjoint_codegen.simulate.run"
    if name == "Tuned":
        return "pmjoint_codegen.studies.tune"
    if name in ("sweep", "tune"):  # packages that can be called
        return "pmjoint_codegen"
    return "pmjoint_codegen.errors" if name in __all__ else None


def __getattr__(name: str) -> object:
    """Import a public name on first use (PEP 562)."""
    from importlib import import_module

    home = _home(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = import_module(f"{__name__}.{name}" if home == __name__ else home)
    value: object = found if home == __name__ else getattr(found, name)
    globals()[name] = value  # later look-ups bypass this function
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *__all__})
