"""Find the C compiler: ``CC``, then ``cc``, ``gcc``, ``clang``."""

from __future__ import annotations

import os
import shlex
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass

CANDIDATES = ("cc", "gcc", "clang")
INSTALL = "apt-get install gcc"


@dataclass(frozen=True)
class Compiler:
    """A C compiler that exists on this machine.

    Attributes:
        command: absolute path of the program, because it runs in another folder, and the flags that came with
            it in ``CC``.
        identity: the program's resolved path, size and modification time: it changes with the compiler, and
            is read without starting it.
    """

    command: tuple[str, ...]
    identity: str


def find_compiler(env: Mapping[str, str], notify: Callable[[str], None] | None = None) -> Compiler | None:
    """Find the compiler to use, or None.

    Args:
        env: environment; ``CC`` may carry flags, ``PATH`` is searched.
        notify: called with one line when ``CC`` names a program that does not exist.
    """
    wanted = env.get("CC", "").strip()
    if wanted:
        found = _compiler(_split(wanted), env)
        if found is not None:
            return found
        if notify is not None:
            notify(f"CC names {wanted!r}, which is not a program here; trying {', '.join(CANDIDATES)}")
    for name in CANDIDATES:
        found = _compiler((name,), env)
        if found is not None:
            return found
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
    resolved = os.path.realpath(program)
    found = os.stat(resolved)
    identity = f"{resolved} {found.st_size} {found.st_mtime_ns}"
    return Compiler(command=(os.path.abspath(program), *command[1:]), identity=identity)
