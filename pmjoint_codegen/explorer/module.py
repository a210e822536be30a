"""A model's closed loop as a WebAssembly module: generated kernels, the loops, and a driver for the page."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pmjoint_codegen.compile.compiler import Compiler
from pmjoint_codegen.compile.zig import wasm_module
from pmjoint_codegen.errors import StaleError
from pmjoint_codegen.explorer.model_header import model_header
from pmjoint_codegen.kernels.compiled import GENERATED
from pmjoint_codegen.provision import Provided

PACKAGE: Final = Path(__file__).parent.parent
EXPORTS: Final = (
    "explorer_place",
    "explorer_actuation",
    "explorer_match",
    "explorer_read",
    "explorer_begin",
    "explorer_advance",
    "explorer_signals",
)


def build_module(provided: Provided, zig: Compiler, cache: Path) -> bytes:
    """Compile a model's closed loop for a browser, or reuse the build.

    Args:
        provided: the kernels.
        zig: as `zig_compiler` gave it.
        cache: folder for builds.

    Raises:
        BuildError: the compiler failed.
        StaleError: a generated file is missing.
    """
    own = [path for folder in ("loops/c", "explorer/c") for path in (PACKAGE / folder).glob("*.[ch]")]
    try:
        sources = {
            path.name: path.read_bytes() for path in (*(provided.folder / name for name in GENERATED), *own)
        }
    except OSError as error:
        raise StaleError(
            f"{error.filename} cannot be read", where=str(provided.folder), remedy="run pmjoint regenerate"
        ) from None
    header = model_header(provided.manifest).encode()
    return wasm_module({**sources, "explorer_model.h": header}, EXPORTS, zig, cache)
