"""Progress of a derivation, reported stage by stage, since a high order takes minutes."""

from __future__ import annotations

from collections.abc import Callable

Stage = Callable[[str, float], None]  # name of the stage, fraction of it completed


def unwatched(name: str, done: float) -> None:
    """Ignore progress."""
