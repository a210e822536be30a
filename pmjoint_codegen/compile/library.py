"""Compile C sources into a shared library, once, in the cache folder.

A build is a folder ``<key>/`` of the cache, where the key covers sources, flags and compiler. The compiler
works in a private folder; its output is moved into place as a whole. So processes that build at once, or are
killed meanwhile, leave a whole build or none. Every file's hash is stored beside it and is verified
before the library is loaded.

Flags in ``CC`` may change results, and some change the arithmetic of the process that loads the library.
`FLAGS` reverses what can be reversed, and every new library is tested in a separate process (``self_test.c``)
before it is kept.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from pmjoint_codegen.compile.compiler import Compiler
from pmjoint_codegen.errors import BuildError, UsageError
from pmjoint_codegen.scratch import scratch
from pmjoint_codegen.storage import drop_link, ensure_folder, replace_folder, sha256

# They come after the flags of CC, so that they win. Bits must not depend on the machine or the optimiser:
# sums stay in order, quotients are quotients, nothing is contracted into fused operations; and no start-up
# code that flushes denormal numbers is linked. -ffp-contract follows -fno-fast-math, which resets it in
# clang.
ARITHMETIC: Final = (
    "-std=c99",
    "-fno-fast-math",
    "-fno-unsafe-math-optimizations",
    "-fno-associative-math",
    "-fno-reciprocal-math",
    "-fno-finite-math-only",
    "-fsigned-zeros",
    "-ffp-contract=off",
)
# Neither of -fno-math-errno, -fno-trapping-math changes a result; without them sine and cosine of one angle
# are two calls, selections are jumps, and square roots and selections are not vectorised. -Wno-psabi: no
# vector is passed between files.
FLAGS: Final = (
    "-O2",
    *ARITHMETIC,
    "-fno-math-errno",
    "-fno-trapping-math",
    "-Wno-psabi",
    "-fPIC",
    "-shared",
)
LIBRARY: Final = "kernels.so"
HASHES: Final = "sha256.json"
PRIVATE: Final = ".build"  # prefix of the name of the folder that a compiler works in
COMPILE_S: Final = 900.0  # no working compiler takes longer; large models take minutes
ASK_S: Final = 60.0
SELF_TEST: Final = "self_test.c"
BROKEN: Final = {  # bit of the result of SELF_TEST -> what the library does
    1: "flushes denormal numbers to zero",
    2: "adds in another order than written",
    4: "divides by reciprocals",
    8: "contracts products and sums",
    16: "computes in another precision than double",
    32: "ignores infinities, NaN or the sign of zero",
}
_ASK: Final = "import ctypes, sys; print(ctypes.CDLL(sys.argv[1]).pmjoint_self_test())"

Extras = Callable[[], Mapping[str, bytes]]


def build(
    sources: Mapping[str, bytes],
    compiler: Compiler,
    cache: Path,
    extras: Extras | None = None,
    flags: Sequence[str] = FLAGS,
    patience: float = COMPILE_S,
) -> Path:
    """Give the folder of the compiled library, building it if the cache has no sound copy.

    Args:
        sources: file name -> content; names ending in ``.c`` are compiled, all others can be included.
        compiler: as `find_compiler` gave it.
        cache: folder for builds.
        extras: gives further files (name -> content) to keep beside the library; called only when it is
            built.
        flags: of the compiler, `FLAGS` and more; they are part of the build's name.
        patience: s; a compiler that takes longer is killed.

    Returns:
        The folder, which holds `LIBRARY` and the extras.

    Raises:
        BuildError: the compiler failed or hangs, ``output`` is its whole text; or the library does not
            compute according to IEEE 754.
        UsageError: the cache cannot be written.
    """
    folder = cache / build_key(sources, compiler, flags)
    drop_link(folder)
    if not is_sound(folder):
        files = {LIBRARY: _compile(sources, compiler, cache, flags, patience), **(extras() if extras else {})}
        hashes = {name: sha256(data) for name, data in files.items()}
        replace_folder(folder, {**files, HASHES: json.dumps(hashes, indent=1).encode()}, private=True)
    return folder


def build_key(sources: Mapping[str, bytes], compiler: Compiler, flags: Sequence[str] = FLAGS) -> str:
    """Name of the build: a hash of sources, flags, compiler and machine type."""
    digest = hashlib.sha256()
    for text in (*flags, *compiler.command, compiler.identity, os.uname().sysname, os.uname().machine):
        digest.update(os.fsencode(text) + b"\0")  # paths and flags may hold bytes that are not text
    for name, content in sorted(_with_self_test(sources).items()):
        digest.update(f"{name} {len(content)}\0".encode() + content)
    return digest.hexdigest()[:32]


def is_sound(folder: Path) -> bool:
    """Whether a build exists and none of its files was altered."""
    try:
        hashes = json.loads((folder / HASHES).read_bytes())
        return LIBRARY in hashes and all(
            sha256((folder / name).read_bytes()) == hashes[name] for name in hashes
        )
    except (OSError, ValueError, TypeError):
        return False


def _with_self_test(sources: Mapping[str, bytes]) -> dict[str, bytes]:
    return {**sources, SELF_TEST: Path(__file__).with_name(SELF_TEST).read_bytes()}


def _compile(
    sources: Mapping[str, bytes], compiler: Compiler, cache: Path, flags: Sequence[str], patience: float
) -> bytes:
    ensure_folder(cache)
    try:
        with scratch(PRIVATE, cache) as private:
            every = _with_self_test(sources)
            for name, content in every.items():
                (private / name).write_bytes(content)
            units = sorted(name for name in every if name.endswith(".c"))
            _call(compiler, [*flags, *units, "-o", LIBRARY, "-lm"], private, patience)
            _ask(private / LIBRARY, compiler)
            return (private / LIBRARY).read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        remedy = "make room, or set PMJOINT_CACHE to another folder"
        raise UsageError(f"cannot be used to build in ({reason})", where=str(cache), remedy=remedy) from error


def _call(compiler: Compiler, arguments: Sequence[str], folder: Path, patience: float) -> None:
    """Run the compiler in a folder of its own."""
    where = compiler.package or compiler.command[0]
    another = "choose another one with CC=..., or use --evaluator interpreted"
    try:
        code, output = run_command([*compiler.command, *arguments], folder, patience)
    except subprocess.TimeoutExpired:
        raise BuildError(
            f"the C compiler did not end within {patience:g} s", where=where, remedy=another
        ) from None
    except OSError as error:  # such as a program for another machine
        code, output = -1, str(error)
    if code != 0 or not (folder / LIBRARY).is_file():
        raise BuildError(
            f"the C compiler failed (exit code {code})", where=where, remedy=another, output=output
        )


def _ask(library: Path, compiler: Compiler) -> None:
    """Load a new library in a separate process, which it may corrupt, and have it test itself."""
    command = [sys.executable, "-I", "-S", "-c", _ASK, str(library)]
    try:
        code, output = run_command(command, library.parent, ASK_S)
    except subprocess.TimeoutExpired:
        code, output = -1, f"no answer within {ASK_S:g} s"
    answer = output.strip()
    where = compiler.shown
    if code != 0 or not answer.isdecimal():
        raise BuildError(
            "the compiled library cannot be loaded here",
            where=where,
            remedy="choose another compiler with CC=..., another folder with PMJOINT_CACHE=..., or use "
            "--evaluator interpreted",
            output="".join(output.splitlines()[-1:]),  # the loader's message ends the traceback
        )
    if faults := [words for bit, words in BROKEN.items() if int(answer) & bit]:
        raise BuildError(
            f"the compiled library {', '.join(faults)}",
            where=where,
            remedy="remove the flags that change results from CC, or use --evaluator interpreted",
        )


def run_command(command: Sequence[str], folder: Path, patience: float) -> tuple[int, str]:
    """Exit code and all output of a program and its children; none of them outlives an interruption.

    Output goes to a file: a pipe would block as long as any of them has it open.

    Args:
        command: program and arguments.
        folder: that it works in.
        patience: s; a program that takes longer is killed, and `subprocess.TimeoutExpired` raised.
    """
    with tempfile.TemporaryFile() as output:
        child = subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder)},  # a compiler that is killed leaves files there
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code = child.wait(patience)
        except BaseException:
            with suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
            raise
        output.seek(0)
        return code, output.read().decode(errors="replace")
