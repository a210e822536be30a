"""zig's C compiler, as a program that behaves like any other ``cc``.

Run as a script, with nothing but the standard library: ``python zig_cc.py ZIG CACHE ARGUMENT...``. zig
differs from other compilers in four ways. Each is removed here, so that make and every caller can use it as
``CC``:

* It keeps the C libraries that it builds in a folder, and stops where no home folder is known. It gets CACHE.
* It compiles for the processor at hand. A library may be used on another one: baseline, unless told.
* It spells the processor levels of x86-64 with underscores.
* Without optimisation it traps on undefined behaviour. It does so only when asked to, as others do.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping, Sequence

_LEVEL = re.compile(r"-march=x86-64(-v[234])?")
_PROCESSOR = ("-march=", "-mcpu=", "-mtune=")


def arguments(given: Sequence[str]) -> list[str]:
    """What zig is given in place of the arguments of a usual C compiler."""
    levels = [(text, _LEVEL.fullmatch(text)) for text in given]
    found = [
        f"-march=x86_64{(level[1] or '').replace('-', '_')}" if level else text for text, level in levels
    ]
    if not any(text.startswith(_PROCESSOR) for text in given):
        found.insert(0, "-mcpu=baseline")
    if not any(text.startswith("-fsanitize") for text in given):
        found.insert(0, "-fno-sanitize=undefined")
    return found


def environment(known: Mapping[str, str], cache: str) -> dict[str, str]:
    """The process's environment, with a place for what zig builds; one that is set already stays."""
    return {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache, **known}


if __name__ == "__main__":
    zig, folder, *rest = sys.argv[1:]
    os.execve(zig, [zig, "cc", *arguments(rest)], environment(os.environ, folder))
