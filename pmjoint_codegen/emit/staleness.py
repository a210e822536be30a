"""Compares ``generated/<name>/`` with fresh output, in one verdict.

current            every byte equals fresh output of the model and the tools
missing            there are no files
edited by hand     a file does not match the hash recorded for it, is absent, or is one too many
model changed      the model file differs from what the folder was made from
generator changed  same model, but the derivation, the emitters or their tools now write other text
orphan             the folder has no model file
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from pmjoint_codegen.emit.changes import Change, changes, content_of
from pmjoint_codegen.errors import OtherVersionError, StaleError
from pmjoint_codegen.manifest import FILE_NAME, Manifest
from pmjoint_codegen.storage import sha256


class Verdict(StrEnum):
    """The relation of a generated folder to its model."""

    CURRENT = "current"
    MISSING = "missing"
    EDITED = "edited by hand"
    MODEL_CHANGED = "model changed"
    GENERATOR_CHANGED = "generator changed"
    ORPHAN = "orphan"


REMEDIES: Mapping[Verdict, str] = {
    Verdict.CURRENT: "",
    Verdict.MISSING: "pmjoint regenerate {name}",
    Verdict.EDITED: "edit the model file, not generated/; then pmjoint regenerate {name}",
    Verdict.MODEL_CHANGED: "pmjoint regenerate {name}",
    Verdict.GENERATOR_CHANGED: "pmjoint regenerate {name}, and review what changed",
    Verdict.ORPHAN: "delete the folder, or restore models/{name}.toml",
}


@dataclass(frozen=True)
class Comparison:
    """A verdict and its reasons.

    Attributes:
        verdict: state of the folder.
        details: one line per reason.
        changes: equations that are new, gone or different.
    """

    verdict: Verdict
    details: tuple[str, ...] = ()
    changes: tuple[Change, ...] = ()


def read_folder(folder: Path) -> dict[str, bytes]:
    """Contents of every file in a folder, by name; empty when there is no folder."""
    if not folder.is_dir():
        return {}
    return {path.name: path.read_bytes() if path.is_file() else b"" for path in sorted(folder.iterdir())}


def tampering(files: Mapping[str, bytes]) -> tuple[Manifest | None, list[str]]:
    """The folder's manifest if it can be trusted, and what does not match the recorded hashes.

    Raises:
        OtherVersionError: when another version of this package wrote the manifest.
    """
    if FILE_NAME not in files:
        return None, [f"{FILE_NAME} is missing"]
    try:
        manifest = Manifest.from_json(files[FILE_NAME].decode("utf-8", "replace"), FILE_NAME)
    except OtherVersionError:
        raise
    except StaleError as error:
        return None, [f"{error.where} {error.what}"]
    found = {name: sha256(data) for name, data in files.items() if name != FILE_NAME}
    lines = [f"{name} is missing" for name in manifest.files if name not in found]
    lines += [f"{name} does not belong here" for name in found if name not in manifest.files]
    lines += [
        f"{name} was edited by hand"
        for name in found
        if name in manifest.files and found[name] != manifest.files[name]
    ]
    return manifest, lines


def compare(files: Mapping[str, bytes], fresh: Mapping[str, str], wanted: Manifest) -> Comparison:
    """Check a folder against fresh output.

    Args:
        files: the existing files, from :func:`read_folder`.
        fresh: the files that would be written.
        wanted: the fresh manifest.
    """
    if not files:
        return Comparison(Verdict.MISSING, ("nothing is generated yet",))
    if files == {name: text.encode() for name, text in fresh.items()}:
        return Comparison(Verdict.CURRENT)
    try:
        recorded, edits = tampering(files)
    except OtherVersionError as error:
        return Comparison(Verdict.GENERATOR_CHANGED, (f"{error.where} {error.what}",))
    if recorded is None or edits:
        return Comparison(Verdict.EDITED, tuple(edits))
    before, after = content_of(files), content_of({name: text.encode() for name, text in fresh.items()})
    equations = changes(before.equations, after.equations)
    if recorded.model_hash != wanted.model_hash:
        values = tuple(map(str, changes(before.values, after.values)))
        return Comparison(Verdict.MODEL_CHANGED, values or ("the model file differs",), equations)
    versions = [
        f"{tool} {recorded.versions.get(tool, 'unknown')} -> {version}"
        for tool, version in wanted.versions.items()
        if recorded.versions.get(tool) != version
    ]
    differing = [
        f"{name} {'has other content' if name in files else 'is new'}"
        for name, text in fresh.items()
        if files.get(name) != text.encode()
    ]
    return Comparison(Verdict.GENERATOR_CHANGED, (*versions, *differing), equations)
