"""One thread at a time in CasADi.

CasADi's reference counts are not atomic, one of its options holds for the whole process, and its Python
bindings release the interpreter's lock in every call. Two threads that build expressions at one time would
therefore disturb each other: seen was a kernel whose sums were in another order. The lock belongs to the
process, as what it guards does.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Final, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_TURN: Final = threading.RLock()


def alone(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function run while no other thread is in such a function."""

    @functools.wraps(function)
    def taken(*args: P.args, **kwargs: P.kwargs) -> R:
        with _TURN:
            return function(*args, **kwargs)

    return taken
