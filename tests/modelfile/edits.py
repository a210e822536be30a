"""Changed copies of a model file's document."""

from __future__ import annotations

from copy import deepcopy
from typing import Any


def with_changes(document: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A copy with some keys set, given as {"plant.order": 3}; a value of None takes the key away."""
    copied = deepcopy(document)
    for path, value in changes.items():
        *tables, key = path.split(".")
        table = copied
        for name in tables:
            table = table[name]
        table[key] = value
        if value is None:
            del table[key]
    return copied
