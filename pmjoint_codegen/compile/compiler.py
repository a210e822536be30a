"""Find the C compiler: ``CC``, then ``cc``, ``gcc``, ``clang``, then the one of the package ziglang."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pmjoint_codegen.errors import installing
from pmjoint_codegen.workspace import cache_dir

CANDIDATES = ("cc", "gcc", "clang")
PACKAGE = "ziglang"
LOOKED_FOR = f"CC, {', '.join(CANDIDATES)}, the package {PACKAGE}"
INSTALL = "apt-get install gcc"
_LAUNCHER = Path(__file__).with_name("zig_cc.py")


@dataclass(frozen=True)
class Compiler:
    """A C compiler that exists on this machine.

    Attributes:
        command: absolute path of the program, because it runs in another folder, and the flags that came with
            it in ``CC``.
        identity: the program's resolved path, size and modification time: it changes with the compiler, and
            is read without starting it.
        package: name of the Python package that brings it; empty for a program of the system.
    """

    command: tuple[str, ...]
    identity: str
    package: str = ""

    @property
    def shown(self) -> str:
        """What a reader is told to have been run."""
        return self.package or shlex.join(self.command)


def install_line() -> str:
    """How to get a compiler: from the system's packages or, without their administrator, from Python's."""
    return f"{INSTALL}, or {installing('pmjoint-codegen[compiler]')}"


def find_compiler(env: Mapping[str, str], notify: Callable[[str], None] | None = None) -> Compiler | None:
    """Find the compiler to use, or None.

    Args:
        env: environment; ``CC`` may carry flags, or be ``ziglang`` for the package; ``PATH`` is searched.
        notify: called with one line when ``CC`` names a program that does not exist.
    """
    wanted = env.get("CC", "").strip()
    if wanted:
        found = packaged(env) if wanted == PACKAGE else _compiler(_split(wanted), env)
        if found is not None:
            return found
        if notify is not None:
            notify(
                f"CC names {wanted!r}, which is not a program here; trying {', '.join(CANDIDATES)}, {PACKAGE}"
            )
    for name in CANDIDATES:
        found = _compiler((name,), env)
        if found is not None:
            return found
    return packaged(env)


def packaged(env: Mapping[str, str]) -> Compiler | None:
    """The compiler of the package ziglang, if it is installed for this interpreter; it is not imported.

    What it builds for itself is kept in the cache folder, so it needs no home folder.
    """
    spec = importlib.util.find_spec(PACKAGE)
    for folder in (spec and spec.submodule_search_locations) or ():
        program = os.path.join(folder, "zig")
        if os.access(program, os.X_OK):
            launched = (
                sys.executable,
                "-I",
                "-S",
                str(_LAUNCHER),
                program,
                str(cache_dir(env).absolute() / "zig"),
            )
            return Compiler(launched, _identity(program), PACKAGE)
    return None


def _split(text: str) -> tuple[str, ...]:
    try:
        return tuple(shlex.split(text))
    except ValueError:  # an unbalanced quote: take it as one name
        return (text,)


def _compiler(command: tuple[str, ...], env: Mapping[str, str]) -> Compiler | None:
    if not command:
        return None
    program = shutil.which(command[0], path=env.get("PATH", os.defpath))
    if program is None:
        return None
    return Compiler(command=(os.path.abspath(program), *command[1:]), identity=_identity(program))


def _identity(program: str) -> str:
    resolved = os.path.realpath(program)
    found = os.stat(resolved)
    return f"{resolved} {found.st_size} {found.st_mtime_ns}"
