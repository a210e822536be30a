"""An exported controller, compiled for this machine and called from Python."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pmjoint_codegen.compile.compiler import Compiler
from pmjoint_codegen.compile.library import LIBRARY, build
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.kernels.evaluator import Array


@dataclass(frozen=True)
class Exported:
    """A loaded controller.

    Attributes:
        export: what was compiled.
        ffi: cffi's parser.
        library: cffi's handle.
        params, constants, state, input, output: one structure each.
    """

    export: Export
    ffi: Any
    library: Any
    params: Any
    constants: Any
    state: Any
    input: Any
    output: Any

    @classmethod
    def load(cls, export: Export, compiler: Compiler, cache: Path) -> Exported:
        """Compile and load an export.

        Args:
            export: the controller.
            compiler: as `find_compiler` gave it.
            cache: folder for builds.

        Raises:
            BuildError: the compiler failed.
        """
        names = [f"{export.identity.prefix}.{end}" for end in "ch"]
        folder = build({name: export.files[name].encode() for name in names}, compiler, cache)
        return cls.open(export, folder / LIBRARY)

    @classmethod
    def open(cls, export: Export, file: Path) -> Exported:
        """Load a compiled export, with the model's own parameters.

        Args:
            export: the controller.
            file: its library.
        """
        import cffi

        prefix, ffi = export.identity.prefix, cffi.FFI()
        ffi.cdef(declarations(export.files[f"{prefix}.h"], export.program.size))
        made = [ffi.new(f"{prefix}_{kind} *") for kind in ("params", "constants", "state", "input", "output")]
        loaded = cls(export, ffi, ffi.dlopen(str(file)), *made)
        loaded.call("defaults", loaded.params)
        return loaded

    def call(self, name: str, *arguments: Any) -> Any:
        """Call an exported function."""
        return getattr(self.library, f"{self.export.identity.prefix}_{name}")(*arguments)

    def init(self, y: float, y_r: Array) -> int:
        """Prepare the controller with the present parameters."""
        self.give(y, y_r)
        return int(self.call("init", self.constants, self.state, self.params, self.input))

    def give(self, y: float, y_r: Array, measured_u: float | None = None) -> None:
        """Fill in the input."""
        self.input.y = y
        for symbol, value in zip(self.export.program.derivation.signals.y_r, y_r, strict=True):
            setattr(self.input, symbol.name, value)
        self.input.use_measured_u = int(measured_u is not None)
        self.input.u_measured = measured_u or 0.0

    def step(self, y: float, y_r: Array, measured_u: float | None = None) -> int:
        """One sample; the result is in `output`."""
        self.give(y, y_r, measured_u)
        return int(self.call("step", self.constants, self.state, self.input, self.output))

    @property
    def states(self) -> Array:
        """The controller's states, in the order of the kernels."""
        return np.array([getattr(self.state, symbol.name) for symbol in self.export.program.states])

    def hold(self) -> Array:
        """The matrices of the exact hold, in the order of `hold_matrices`."""
        program, found = self.export.program, []
        for label, matrix in (("F0", "F0"), ("G0", "G0"), ("Fr", "Fr"), ("Gr", "Gr")):
            n = getattr(program.hold, matrix).rows
            entries = getattr(self.constants, label)
            found += [entries[i][j] for i in range(n) for j in range(n)]
        return np.array(found)


def declarations(header: str, size: int) -> str:
    """The header as cffi's parser takes it: without comments and directives."""
    plain = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    lines = [line for line in plain.splitlines() if not line.startswith("#") and 'extern "C"' not in line]
    text = "\n".join(lines).rstrip().removesuffix("}")
    return re.sub(r"\bPMJOINT_\w+_SIZE\b", str(size), text)
