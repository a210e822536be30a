"""cffi's declarations, from the headers as they are, and the libraries loaded with them.

cffi parses C only to find what may be called. That takes longer than a whole run, so it is done when a
library is built. The result is kept as Python text beside the library, so loading needs no parser.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from pmjoint_codegen.compile.library import LIBRARY
from pmjoint_codegen.errors import BuildError
from pmjoint_codegen.scratch import scratch

MODULE = "declarations.py"
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


def exported(name: str) -> str:
    """The name in C of a kernel: a linker's names are everybody's."""
    return f"pmjoint_{name}"


def declarations(kernels_header: str, runtime_header: str, names: Iterable[str]) -> str:
    """Collect the declarations to give to cffi.

    Args:
        kernels_header: text of ``kernels.h``.
        runtime_header: text of ``pmjoint_runtime.h``.
        names: kernels that will be called; others are omitted, as parsing costs time.

    Raises:
        ValueError: the header declares no such kernel.
    """
    declared = {re.split(r"[\s(]+", line)[1]: line for line in _statements(kernels_header)}
    wanted = {name: exported(name) for name in names}
    missing = [name for name, symbol in wanted.items() if symbol not in declared]
    if missing:
        raise ValueError(f"kernels.h declares no {', '.join(missing)}")
    return "\n".join([*_lines(runtime_header), *(declared[symbol] for symbol in wanted.values())])


def to_module(text: str) -> str:
    """Parse declarations; give the Python text from which `load_module` restores them."""
    import cffi

    ffi = cffi.FFI()
    ffi.cdef(text)
    ffi.set_source("pmjoint_kernels", None)
    with scratch("pmjoint-declarations") as folder:
        path = folder / MODULE
        with redirect_stdout(StringIO()):  # cffi announces the file there
            ffi.emit_python_code(str(path))
        return path.read_text(encoding="utf-8")


def load_module(text: str) -> Any:
    """The ``ffi`` object of a text that `to_module` made.

    The text is read as data: one call of ``FFI`` with literals. Nothing in it is executed.

    Raises:
        BuildError: the text is anything else.
    """
    from _cffi_backend import FFI

    try:
        *imports, made = ast.parse(text).body
        if not all(isinstance(line, ast.Import | ast.ImportFrom) for line in imports):
            raise ValueError("holds statements")
        if not isinstance(made, ast.Assign) or not isinstance(made.value, ast.Call):
            raise ValueError("makes no declarations")
        values = [ast.literal_eval(value) for value in made.value.args]
        named = {key.arg: ast.literal_eval(key.value) for key in made.value.keywords if key.arg}
        return FFI(*values, **named)
    except (ValueError, SyntaxError, TypeError, RecursionError) as error:
        raise BuildError(
            f"{MODULE} of a build in the cache was altered",
            remedy="empty the cache folder, which `pmjoint doctor` names",
            output=str(error),
        ) from error


def load_library(built: Path) -> tuple[Any, Any]:
    """The ``ffi`` object and the library of a build that holds a `MODULE`.

    Raises:
        BuildError: the system cannot load it: it is for another machine, or its place forbids execution.
    """
    ffi = load_module((built / MODULE).read_text(encoding="utf-8"))
    library = str(built / LIBRARY)
    try:
        return ffi, _open(ffi, library)
    except OSError as error:
        raise BuildError(
            "the compiled library cannot be loaded here",
            where=library,
            remedy="choose another compiler with CC=..., another folder with PMJOINT_CACHE=..., or use "
            "--evaluator interpreted",
            output=str(error),
        ) from error


def _open(ffi: Any, library: str) -> Any:
    """Load a library, even if the locale's encoding cannot represent its path."""
    try:
        library.encode(sys.getfilesystemencoding())
    except UnicodeEncodeError:  # cffi encodes strictly; ctypes as Python's own file functions do
        import ctypes

        return ffi.dlopen(ffi.cast("void *", ctypes.CDLL(library)._handle))
    return ffi.dlopen(library)


def _lines(header: str) -> list[str]:
    """Lines of a header without comments and without the preprocessor's lines."""
    return [
        line for line in _COMMENT.sub(" ", header).splitlines() if line.strip() and not line.startswith("#")
    ]


def _statements(header: str) -> list[str]:
    return [
        f"{' '.join(statement.split())};"
        for statement in "\n".join(_lines(header)).split(";")
        if statement.strip()
    ]
