"""Compile C for another machine with zig's clang, which brings every target's C library along.

It comes from the package index (extra ``compiler``), so no cross compiler of the system is needed. zig keeps
the C libraries that it has built in the cache folder: the first use of a target takes half a minute.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from subprocess import TimeoutExpired
from typing import Final

from pmjoint_codegen.compile import compiler
from pmjoint_codegen.compile.compiler import PACKAGE, Compiler
from pmjoint_codegen.compile.library import ARITHMETIC, COMPILE_S, run_command
from pmjoint_codegen.errors import BuildError, MissingToolError, installing
from pmjoint_codegen.scratch import scratch
from pmjoint_codegen.storage import drop_link, ensure_folder, replace_folder, sha256

# A reactor is a library: it has exports and no main. WebAssembly has neither a fused product and sum nor
# modes of rounding, so ARITHMETIC fixes every bit.
WASM: Final = (
    "--target=wasm32-wasi",
    "-mexec-model=reactor",
    "-O2",
    *ARITHMETIC,
    "-fno-math-errno",
    "-fno-trapping-math",
    "-Wall",
    "-Wextra",
    "-Wno-unused-parameter",  # CasADi gives every kernel the same ones
    "-Werror",
    "-s",
)
OUTPUT: Final = "out.wasm"
HASH: Final = "sha256"


def zig_compiler(env: Mapping[str, str], purpose: str = "compile for WebAssembly") -> Compiler:
    """Zig's C compiler.

    Args:
        env: environment: the place of the cache.
        purpose: what it is needed to do, for the message.

    Raises:
        MissingToolError: ziglang is not installed.
    """
    found = compiler.packaged(env)
    if found is None:
        raise MissingToolError(
            f"{PACKAGE} is needed to {purpose}",
            remedy=f"install it: {installing('pmjoint-codegen[compiler]')}",
        )
    return found


def wasm_module(
    sources: Mapping[str, bytes],
    exports: Sequence[str],
    zig: Compiler,
    cache: Path,
    linker: Sequence[str] = (),
) -> bytes:
    """Compile C sources into a WebAssembly module without imports, once.

    Args:
        sources: file name -> content; names ending in ``.c`` are compiled, all others can be included.
        exports: names of the functions that the module gives to its host.
        zig: as `zig_compiler` gave it.
        cache: folder for builds.
        linker: options of the linker.

    Raises:
        BuildError: the compiler failed or hangs; ``output`` is its whole text.
        UsageError: the cache cannot be written.
    """
    flags = (*WASM, *(f"-Wl,--export={name}" for name in exports), *(f"-Wl,{option}" for option in linker))
    content = b"".join(f"{name} {len(data)}\0".encode() + data for name, data in sorted(sources.items()))
    key = sha256("\0".join((zig.identity, *flags, "")).encode() + content)[:32]
    folder = cache / "wasm" / key
    drop_link(folder)
    kept = _kept(folder)
    if kept is not None:
        return kept
    ensure_folder(folder.parent)
    with scratch(".build", folder.parent) as private:
        for name, data in sources.items():
            (private / name).write_bytes(data)
        units = sorted(name for name in sources if name.endswith(".c"))
        _call([*zig.command, *flags, *units, "-lm", "-o", OUTPUT], private)
        made = (private / OUTPUT).read_bytes()
    replace_folder(folder, {OUTPUT: made, HASH: sha256(made).encode()}, private=True)
    return made


def _kept(folder: Path) -> bytes | None:
    """The module of an earlier build, if nobody has altered it."""
    try:
        made = (folder / OUTPUT).read_bytes()
        return made if sha256(made).encode() == (folder / HASH).read_bytes() else None
    except OSError:
        return None


def _call(command: list[str], folder: Path) -> None:
    remedy = "reinstall ziglang, or set PMJOINT_CACHE to a folder with room"
    try:
        code, output = run_command(command, folder, COMPILE_S)
    except TimeoutExpired:
        raise BuildError(f"zig did not end within {COMPILE_S:g} s", where=PACKAGE, remedy=remedy) from None
    if code != 0 or not (folder / OUTPUT).is_file():
        raise BuildError(
            f"zig's C compiler failed (exit code {code})", where=PACKAGE, remedy=remedy, output=output
        )
