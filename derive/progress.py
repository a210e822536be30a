"""Who watches a derivation: told each stage by name, since a high order takes minutes."""

from __future__ import annotations

from collections.abc import Callable

Stage = Callable[[str, float], None]  # name of what begins, or goes on; the part of it that is done, 0 to 1


def unwatched(name: str, done: float) -> None:
    """Tell nobody."""
