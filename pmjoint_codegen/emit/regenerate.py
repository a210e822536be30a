"""The one command that writes ``generated/``: each model's folder, all or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pmjoint_codegen.emit.pipeline import generate
from pmjoint_codegen.emit.staleness import REMEDIES, Comparison, Verdict, compare, read_folder
from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.identity import Document
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.storage import replace_folder
from pmjoint_codegen.workspace import called, find_model, generated_root, model_folders
from pmjoint_derive.progress import Stage, unwatched


@dataclass(frozen=True)
class Report:
    """The findings and actions for one model.

    Attributes:
        name: the model.
        folder: its folder under ``generated/``.
        comparison: state of the folder before anything was written.
        written: whether it was written.
        called: the model's name on a command line, if different.
    """

    name: str
    folder: Path
    comparison: Comparison
    written: bool
    called: str = ""

    @property
    def stale(self) -> bool:
        """Whether the folder was not current."""
        return self.comparison.verdict is not Verdict.CURRENT

    @property
    def remedy(self) -> str:
        """The command or action that fixes it."""
        return REMEDIES[self.comparison.verdict].format(name=self.called or self.name)


def regenerate(models: Sequence[str] = (), *, check: bool = False, stage: Stage = unwatched) -> list[Report]:
    """Write the folders of some models, or of all; with ``check`` only report what is stale.

    Args:
        models: names or paths; none means every model of the first ``models/`` folder in sight, and orphans
            count.
        check: write nothing.
        stage: called with each stage, model by model.

    Raises:
        ModelError: for a model that cannot be read or derived, or whose name another file beside it has.
        UsageError: for a folder that cannot be written; no folder is left half written.
    """
    files = [find_model(model) for model in models] or _all_models()
    documents = [read_document(file) for file in files]  # once: a pipe cannot be read again
    pairs = list(zip(files, documents, strict=True))
    for file, document in pairs:
        _refuse_namesakes(file, document)
    reports = [_one(file, document, _naming(file, stage), check=check) for file, document in pairs]
    return reports if models else [*reports, *_orphans(files, documents)]


def _naming(file: Path, stage: Stage) -> Stage:
    """Report stages with the name of their model."""
    return lambda name, done: stage(f"{file.stem}: {name}", done)


def _all_models() -> list[Path]:
    folders = model_folders()
    files = sorted(folders[0].glob("[!.]*.toml")) if folders else []
    return [file for file in files if file.is_file()]


def _refuse_namesakes(file: Path, document: Document) -> None:
    """Refuse a file with the same model name as another one beside it: both would write one folder.

    Raises:
        ModelError: naming both.
    """
    name = document.get("name")
    for other in sorted(file.parent.glob("[!.]*.toml")):
        if other.name != file.name and other.is_file() and name is not None and _name(other) == name:
            raise ModelError(
                f"has the name {quoted(name)}, as {other} has, and so the same generated folder",
                where=str(file),
                remedy=f"give one of them another: name = {quoted(file.stem)}",
            )


def _name(file: Path) -> object:
    """The model name in a file; nothing if the file cannot be read: it does not matter here."""
    try:
        return read_document(file).get("name")
    except ModelError:
        return None


def _one(file: Path, document: Document, stage: Stage, *, check: bool) -> Report:
    try:
        stage("reading the model", 0.0)
        artifacts = generate(document, model_of(document, str(file)), stage=stage)
    except ArithmeticError as error:  # a derivation that contradicts itself, not a bad model
        if not check:
            raise
        return _failed(file, document, error)
    folder = generated_root(file) / artifacts.manifest.name
    comparison = compare(read_folder(folder), artifacts.files, artifacts.manifest)
    write = comparison.verdict is not Verdict.CURRENT and not check
    if write:
        replace_folder(folder, {name: text.encode() for name, text in artifacts.files.items()})
    return Report(artifacts.manifest.name, folder, comparison, written=write, called=called(file))


def _failed(file: Path, document: Document, error: ArithmeticError) -> Report:
    name = str(document["name"])
    found = Comparison(Verdict.GENERATOR_CHANGED, (f"the derivation fails: {error}",))
    return Report(name, generated_root(file) / name, found, written=False, called=called(file))


def _orphans(files: Sequence[Path], documents: Sequence[Document]) -> list[Report]:
    if not files:
        return []
    root = generated_root(files[0])
    known = {document.get("name") for document in documents}
    folders = (
        sorted(path for path in root.iterdir() if path.is_dir() and path.name[0] != ".")
        if root.is_dir()
        else []
    )
    lost = Comparison(Verdict.ORPHAN, ("no model file has this name",))
    return [Report(path.name, path, lost, written=False) for path in folders if path.name not in known]
