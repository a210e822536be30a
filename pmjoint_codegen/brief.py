"""Short texts of records that hold much data, for a console.

A record says `__repr__ = brief` in its body; then it prints its fields, an array by its shape, a long
collection by its length, a long text by its beginning.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

_MOST_ITEMS: Final = 8
_MOST_CHARACTERS: Final = 80


def brief(record: Any) -> str:
    """Print a record in a line or a few: ``Name(field=value, ...)``."""
    inside = (f"{item.name}={part(getattr(record, item.name))}" for item in fields(record) if item.repr)
    return f"{type(record).__name__}({', '.join(inside)})"


def part(value: Any) -> str:
    """Print a value as a part of a record."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape and hasattr(value, "dtype"):
        return f"<array {' x '.join(map(str, shape))}>"
    if is_dataclass(value) and not isinstance(value, type):
        return f"<{type(value).__name__}>"
    if isinstance(value, Mapping):
        return _collection(value, [f"{key}: {part(item)}" for key, item in _some(value.items())], "{}")
    if isinstance(value, tuple | list | frozenset | set):
        return _collection(value, [part(item) for item in _some(value)], "()")
    text = repr(value)
    return f"<{type(value).__name__}>" if " at 0x" in text or "\n" in text else _cut(text)


def _some(items: Any) -> list[Any]:
    return [item for _, item in zip(range(_MOST_ITEMS + 1), items, strict=False)]


def _collection(value: Any, shown: list[str], ends: str) -> str:
    inside = ", ".join(shown)
    if len(value) <= _MOST_ITEMS and len(inside) <= _MOST_CHARACTERS:
        return f"{ends[0]}{inside}{ends[1]}"
    return f"<{len(value)} items>"


def _cut(text: str) -> str:
    return text if len(text) <= _MOST_CHARACTERS else f"{text[: _MOST_CHARACTERS - 3]}..."
