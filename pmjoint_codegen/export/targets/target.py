"""What a target takes and gives, and the table of targets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

if TYPE_CHECKING:
    from pmjoint_codegen.export.source import Identity
    from pmjoint_codegen.export.tree import Precision
    from pmjoint_derive import Derivation


@dataclass(frozen=True)
class Entry:
    """One target: its name, the module that holds it as ``TARGET``, its line in the help."""

    name: str
    module: str
    line: str


TARGETS = (
    Entry("c", "pmjoint_codegen.export.targets.c", "readable C99 with a self test and an example"),
    Entry("cortex-m4f", "pmjoint_codegen.export.pil.cortex_m4f", "the same on an emulated Arm Cortex-M4F"),
    Entry("riscv32", "pmjoint_codegen.export.pil.riscv32", "the same on an emulated RISC-V of 32 bits"),
    Entry(
        "fmu",
        "pmjoint_codegen.export.targets.fmu",
        "co-simulation FMUs of controller and plant, FMI 2.0 and 3.0",
    ),
    Entry("wasm", "pmjoint_codegen.export.bindings.wasm", "a WebAssembly module for browsers and node"),
    Entry(
        "matlab",
        "pmjoint_codegen.export.bindings.matlab",
        "a class and a MEX function for MATLAB and GNU Octave",
    ),
)
PLATFORMS: Final = ("x86_64-linux", "aarch64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin")


@dataclass(frozen=True)
class Order:
    """What to export.

    Attributes:
        derivation: of the model.
        identity: names and hash.
        document: the model file's contents.
        precision: of the numbers.
        environment: of the process: CC, PATH, the place of the cache.
        file: the model file, from which files with data are looked for.
        notify: called with one line that the reader should see.
        platforms: for which binaries are asked beyond this one, where the format has any.
        hold: the matrices of the exact hold are ``computed`` by init, or ``baked`` in.
    """

    derivation: Derivation
    identity: Identity
    document: Mapping[str, Any]
    precision: Precision
    environment: Mapping[str, str]
    file: Path
    notify: Callable[[str], None] | None = None
    platforms: tuple[str, ...] = ()
    hold: str = "computed"


@dataclass(frozen=True)
class Report:
    """What is told of an export or of a run of it.

    Attributes:
        record: joins the JSON document.
        lines: joins the text.
    """

    record: Mapping[str, Any] = field(default_factory=dict)
    lines: tuple[str, ...] = ()


@dataclass(frozen=True)
class Delivery:
    """What an export consists of.

    Attributes:
        files: path inside the folder, with slashes -> contents.
        report: what is told of it.
    """

    files: Mapping[str, str | bytes]
    report: Report


@dataclass(frozen=True)
class Target:
    """How one target is written and run.

    Attributes:
        deliver: makes the files; it writes none.
        run: builds the written folder with the target's own tools, and runs it. Raises `MissingToolError`
            if a tool is absent, `BuildError` if it does not build, `CheckFailed` if it does not hold.
        bakes: whether it takes an order with the hold baked in; not where gains must stay tunable.
    """

    deliver: Callable[[Order], Delivery]
    run: Callable[[Order, Path], Report]
    bakes: bool = False


def target_named(name: str) -> Target:
    """The target of a name in the table."""
    (entry,) = (item for item in TARGETS if item.name == name)
    return cast(Target, import_module(entry.module).TARGET)
