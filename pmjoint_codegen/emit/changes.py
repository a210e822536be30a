"""The contents of a model's generated files, and the differences between two versions of them.

Reads the JSON as it is, not as this version's `Manifest`: an earlier revision may have written other fields.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pmjoint_codegen.manifest import FILE_NAME
from pmjoint_codegen.values import SI, from_si

EQUATIONS = "equations.json"


@dataclass(frozen=True)
class Content:
    """The contents of one generated folder.

    Attributes:
        equations: right-hand side of each named equation, in the order of the derivation.
        values: other statements of the model file: numbers in its units, default run, descriptions.
        operations: number of elementary operations of each kernel.
        sizes: bytes of each file.
        units: of the states and reported signals.
    """

    equations: Mapping[str, str]
    values: Mapping[str, object]
    operations: Mapping[str, int]
    sizes: Mapping[str, int]
    units: Mapping[str, str]


@dataclass(frozen=True)
class Change:
    """A named item that is new, gone or different.

    Attributes:
        name: of the equation, value, kernel or file.
        before: the old content; None if new.
        after: the new content; None if gone.
    """

    name: str
    before: Any
    after: Any

    def equation_lines(self) -> Iterator[str]:
        """The change of an equation as a diff shows it."""
        if self.before is not None:
            yield f"- {self.name} = {self.before}"
        if self.after is not None:
            yield f"+ {self.name} = {self.after}"

    def __str__(self) -> str:
        """The change in one line."""
        if self.before is None:
            return f"{self.name}: new, {self.after}"
        if self.after is None:
            return f"{self.name}: gone, was {self.before}"
        return f"{self.name}: {self.before} -> {self.after}"


def content_of(files: Mapping[str, bytes]) -> Content:
    """Read the contents of generated files.

    Args:
        files: name -> content, `model.json` among them.

    Raises:
        KeyError, TypeError, ValueError: no version has written them.
    """
    manifest = json.loads(files[FILE_NAME])
    stored = json.loads(files.get(EQUATIONS, files[FILE_NAME]))["equations"]
    return Content(
        equations={item["name"]: item["text"] for item in stored},
        values=_values(manifest),
        operations={item["name"]: item["operations"] for item in manifest["functions"]},
        sizes={name: len(files[name]) for name in sorted(files)},
        units={item["name"]: item["unit"] for item in (*manifest["states"], *manifest["signals"])},
    )


def changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[Change, ...]:
    """Items that are new, gone or different, in the order of `after`; gone ones stay at their place."""
    names = list(after)
    place = 0
    for name in before:
        if name in after:
            place = names.index(name)
        else:
            names.insert(place, name)
        place += 1
    return tuple(
        Change(name, before.get(name), after.get(name))
        for name in names
        if before.get(name) != after.get(name)
    )


def _values(manifest: Mapping[str, Any]) -> dict[str, object]:
    """The statements of a model file besides its equations, by name."""
    others = {
        **manifest["simulation"],
        "D_max": manifest["disturbance_bound"],
        **{key: manifest[key] for key in ("limit", "title", "source")},
    }
    stated = {  # a parameter may have the name of one of these
        f"parameter {item['name']}" if item["name"] in others else item["name"]: item
        for item in manifest["parameters"]
        if item["kind"] != "own"
    }
    return {
        **{name: from_si(item["value"], item.get("scale", SI)) for name, item in stated.items()},
        **{f"unit of {item['name']}": item["unit"] for item in stated.values()},
        **{f"meaning of {item['name']}": item["about"] for item in stated.values()},
        **others,
    }
