"""Compile C sources into a shared library, once, in the cache folder.

A build is a folder ``<key>/`` of the cache, where the key covers sources, flags and compiler. The compiler
works in a private folder; what it made is moved into place whole, so that processes building at once, or
killed while they do, leave a whole build or none. Every file's hash stands beside it and is verified before
the library is loaded.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from pmjoint_codegen.build.compiler import Compiler
from pmjoint_codegen.errors import BuildError, UsageError
from pmjoint_codegen.storage import drop_link, ensure_folder, replace_folder, sha256

# Bits must not depend on the machine or the optimiser: no contraction into fused operations.
FLAGS: Final = ("-O2", "-std=c99", "-ffp-contract=off", "-fPIC", "-shared")
LIBRARY: Final = "kernels.so"
HASHES: Final = "sha256.json"
PRIVATE: Final = ".build-"  # beginning of the name of the folder that a compiler works in
ABANDONED_S: Final = 24 * 3600.0  # no build takes a day

TIMEOUT_S: Final = 1800.0  # the largest models take minutes; a compiler that hangs is never done

Extras = Callable[[], Mapping[str, bytes]]


def build(
    sources: Mapping[str, bytes],
    compiler: Compiler,
    cache: Path,
    extras: Extras | None = None,
    flags: Sequence[str] = FLAGS,
) -> Path:
    """Give the folder of the compiled library, building it if the cache has no sound copy.

    Args:
        sources: file name -> content; names ending in ``.c`` are compiled, all others are there to be
            included.
        compiler: as `find_compiler` gave it.
        cache: folder for builds.
        extras: gives further files (name -> content) to keep beside the library; called only when it is
            built.
        flags: of the compiler; they are part of the build's name.

    Returns:
        The folder, which holds `LIBRARY` and the extras.

    Raises:
        BuildError: the compiler failed; ``output`` is its whole text.
        UsageError: the cache cannot be written.
    """
    folder = cache / build_key(sources, compiler, flags)
    drop_link(folder)
    if not is_sound(folder):
        files = {LIBRARY: _compile(sources, compiler, cache, flags), **(extras() if extras else {})}
        hashes = {name: sha256(data) for name, data in files.items()}
        replace_folder(folder, {**files, HASHES: json.dumps(hashes, indent=1).encode()}, private=True)
    return folder


def build_key(sources: Mapping[str, bytes], compiler: Compiler, flags: Sequence[str] = FLAGS) -> str:
    """Name of the build: a hash of sources, flags, compiler and machine type."""
    digest = hashlib.sha256()
    for text in (*flags, *compiler.command, compiler.identity, os.uname().sysname, os.uname().machine):
        digest.update(text.encode() + b"\0")
    for name, content in sorted(sources.items()):
        digest.update(f"{name} {len(content)}\0".encode() + content)
    return digest.hexdigest()[:32]


def is_sound(folder: Path) -> bool:
    """Whether a build is there and every file in it is what was written."""
    try:
        hashes = json.loads((folder / HASHES).read_bytes())
        return LIBRARY in hashes and all(
            sha256((folder / name).read_bytes()) == hashes[name] for name in hashes
        )
    except (OSError, ValueError, TypeError):
        return False


def _compile(sources: Mapping[str, bytes], compiler: Compiler, cache: Path, flags: Sequence[str]) -> bytes:
    ensure_folder(cache)
    _clear_abandoned(cache)
    try:
        with tempfile.TemporaryDirectory(prefix=PRIVATE, dir=cache) as private:
            for name, content in sources.items():
                (Path(private) / name).write_bytes(content)
            units = sorted(name for name in sources if name.endswith(".c"))
            _call([*compiler.command, *flags, *units, "-o", LIBRARY, "-lm"], Path(private))
            return (Path(private) / LIBRARY).read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        remedy = "make room, or set PMJOINT_CACHE to another folder"
        raise UsageError(f"cannot be used to build in ({reason})", where=str(cache), remedy=remedy) from error


def _clear_abandoned(cache: Path) -> None:
    """Remove the private folders of builds that were killed: those that nobody has touched for `ABANDONED_S`.

    Another process may do the same, or a folder be another user's: what cannot be removed is left.
    """
    oldest = time.time() - ABANDONED_S
    with suppress(OSError):
        for folder in cache.glob(f"{PRIVATE}*"):
            with suppress(OSError):
                if folder.lstat().st_mtime < oldest:
                    shutil.rmtree(folder, ignore_errors=True)


def _call(command: list[str], folder: Path) -> None:
    """Run the compiler in a folder of its own."""
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
            timeout=TIMEOUT_S,
        )
        output, code = done.stdout.decode(errors="replace"), done.returncode
    except subprocess.TimeoutExpired as error:
        raise BuildError(
            f"the C compiler did not end within {TIMEOUT_S:g} s",
            where=command[0],
            remedy="choose another one with CC=..., or use --evaluator interpreted",
            output="",
        ) from error
    except OSError as error:  # not a program for this machine, for one
        output, code = str(error), -1
    if code != 0 or not (folder / LIBRARY).is_file():
        raise BuildError(
            f"the C compiler failed (exit code {code})",
            where=command[0],
            remedy="choose another one with CC=..., or use --evaluator interpreted",
            output=output,
        )
