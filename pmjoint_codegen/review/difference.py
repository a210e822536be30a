"""Two versions of a model side by side: equations, values, sizes of the generated code, golden figures.

A version is read from its generated folder, or rederived if that folder does not follow from its model file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pmjoint_codegen.check.gates import golden
from pmjoint_codegen.check.trajectory import Trajectory
from pmjoint_codegen.emit.changes import Change, Content, changes, content_of
from pmjoint_codegen.emit.staleness import read_folder, tampering
from pmjoint_codegen.errors import OtherVersionError
from pmjoint_codegen.identity import Document, model_hash
from pmjoint_codegen.manifest import FILE_NAME
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.review.checkout import check_out, named_as
from pmjoint_codegen.review.revision import find_revision
from pmjoint_codegen.scratch import scratch
from pmjoint_codegen.workspace import GENERATED, find_model, generated_root
from pmjoint_derive.progress import Stage, unwatched


@dataclass(frozen=True)
class Version:
    """One version of a model.

    Attributes:
        name: of the model.
        source: the origin of its content, in words.
        content: of its generated files.
        golden_source: its golden file, or why there is no trajectory.
        trajectory: from the golden files; None if they are missing or damaged.
    """

    name: str
    source: str
    content: Content
    golden_source: str
    trajectory: Trajectory | None


@dataclass(frozen=True)
class Difference:
    """The differences between two versions.

    Attributes:
        before: the earlier one.
        after: the later one.
        equations: in the order of the derivation.
        values: the model file's statements besides equations.
        operations: of the kernels.
        sizes: of the generated files, bytes.
        figures: of the golden trajectories, with their units.
        deviation: largest difference of the golden trajectories, relative to max(1, |value|); None where
            these have other columns or instants, or one is missing.
    """

    before: Version
    after: Version
    equations: tuple[Change, ...]
    values: tuple[Change, ...]
    operations: tuple[Change, ...]
    sizes: tuple[Change, ...]
    figures: tuple[Change, ...]
    deviation: float | None


def difference(model: str, revision: str = "HEAD", stage: Stage = unwatched) -> Difference:
    """Compare a model in a revision with the working tree.

    Args:
        model: name or path.
        revision: any name that git knows.
        stage: called with the stage of a derivation, if there is one.

    Raises:
        UsageError: no repository, no such revision, or no such model in it.
        MissingToolError: git is not installed.
        ModelError: a version must be derived and cannot be.
    """
    file = find_model(model)
    found = find_revision(file, revision)
    with scratch("pmjoint-diff") as root:
        earlier = check_out(file, found, root)
        with named_as(file, earlier, found):
            before = _version(earlier, f" at {found.name}", stage)
    return _compared(before, _version(file, "", stage))


def _compared(before: Version, after: Version) -> Difference:
    old, new = before.content, after.content
    return Difference(
        before,
        after,
        changes(old.equations, new.equations),
        changes(old.values, new.values),
        changes(old.operations, new.operations),
        changes(old.sizes, new.sizes),
        changes(_figures(before), _figures(after)),
        _deviation(before.trajectory, after.trajectory),
    )


def _version(file: Path, when: str, stage: Stage) -> Version:
    """Read one version of a model, `when` being the revision in words."""
    document = read_document(file)
    name = str(document.get("name"))
    source = f"{GENERATED}/{name}{when}"
    files = read_folder(generated_root(file) / name)
    content, fault = _content(files, document)
    if content is None:
        source = f"the model file{when}, derived now: {source} {fault}"
        content = content_of(_derived(file, document, stage))
    rows, switches = golden.files_of(file, name)
    try:
        trajectory, told = golden.read(rows, switches), f"golden/{rows.name}{when}"
    except OSError:
        trajectory, told = None, f"no golden/{rows.name}{when}"
    except ValueError as error:
        trajectory, told = None, f"golden/{rows.name}{when} is damaged: {error}"
    return Version(name, source, content, told, trajectory)


def _content(files: Mapping[str, bytes], document: Document) -> tuple[Content | None, str]:
    """Read a generated folder; None, and why, if it does not follow from the model file."""
    if not files:
        return None, "is missing"
    try:
        manifest, edits = tampering(files)
        if manifest is None or edits:
            return None, "was edited by hand"
    except OtherVersionError:  # its JSON may still have the content needed here
        pass
    try:
        made_from = json.loads(files[FILE_NAME])["model_hash"]
        content = content_of(files)
    except (KeyError, TypeError, ValueError):
        return None, "was written by a version with another format"
    return (content, "") if made_from == model_hash(document) else (None, "does not follow from it")


def _derived(file: Path, document: Document, stage: Stage) -> dict[str, bytes]:
    from pmjoint_codegen.emit.pipeline import generate
    from pmjoint_codegen.modelfile import model_of

    fresh = generate(document, model_of(document, str(file)), stage=stage).files
    return {name: text.encode() for name, text in fresh.items()}


def _figures(version: Version) -> dict[str, Any]:
    """Figures of a golden trajectory, by name with the unit."""
    run = version.trajectory
    if run is None:
        return {}
    units = version.content.units
    found: dict[str, Any] = {"rows": len(run.t), "horizon (s)": float(run.t[-1])}
    for k, name in enumerate(run.names):
        if name in ("x1", "v"):
            found[f"largest |{name}| ({units.get(name, '')})"] = float(np.abs(run.values[:, k]).max())
            found[f"{name} at the end ({units.get(name, '')})"] = float(run.values[-1, k])
    found["saturation switches"] = len(run.switches)
    if run.switches:
        found["last switch (s)"] = run.switches[-1][0]
    return found


def _deviation(before: Trajectory | None, after: Trajectory | None) -> float | None:
    if before is None or after is None:
        return None
    if before.names != after.names or not np.array_equal(before.t, after.t):
        return None
    scale = np.maximum(1.0, np.abs(before.values))
    return float((np.abs(after.values - before.values) / scale).max())
