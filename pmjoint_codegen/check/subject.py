"""The subject of the gates: one model, a fresh derivation of it, and its generated folder as it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pmjoint_codegen.check import harness
from pmjoint_codegen.check.inputs.features import Features
from pmjoint_codegen.check.inputs.points import Batch, batches
from pmjoint_codegen.compile.compiler import Compiler, find_compiler
from pmjoint_codegen.emit.table import Kernel, kernel_table
from pmjoint_codegen.emit.vocabulary import vocabulary
from pmjoint_codegen.identity import Document, canonical_hash, model_hash
from pmjoint_codegen.kernels import compiled, interpreted
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.kernels.tape import FILE_NAME, Tape, read_tapes
from pmjoint_codegen.manifest import Function, Manifest
from pmjoint_codegen.storage import sha256_file
from pmjoint_codegen.workspace import cache_dir, generated_root
from pmjoint_derive import Derivation, Model, derive
from pmjoint_derive.progress import Stage, unwatched

Notify = Callable[[str], None]


@dataclass(frozen=True)
class Subject:
    """One model under check. Slow data are computed when a gate first needs them.

    Attributes:
        file: the model file.
        document: its contents.
        model: the same, as input of the derivation.
        folder: ``generated/<name>/``, as it is.
        environment: for compiler and cache.
        notify: called with a one-line message for the user.
        stage: called with the stage of the derivation.
    """

    file: Path
    document: Document
    model: Model
    folder: Path
    environment: Mapping[str, str]
    notify: Notify
    stage: Stage = unwatched

    @cached_property
    def fingerprint(self) -> str:
        """A hash of all that the gates' results depend on, except the machine's compilers and tools.

        That is the model, its generated and golden files, the sources of this package, and the versions of
        the tools that shape generated text.
        """
        from importlib import metadata  # slow to import

        root = Path(__file__).resolve().parents[2]
        sources = [
            path
            for folder in ("pmjoint_derive", "pmjoint_codegen")
            for path in sorted((root / folder).rglob("*.*"))
            if path.suffix in (".py", ".c", ".h", ".in")
        ]
        golden = self.folder.parent.parent / "golden"
        made = sorted([*self.folder.glob("*.*"), *golden.glob(f"{self.model.name}.*")])
        files = [(path.name, sha256_file(path)) for path in (*sources, *made)]
        versions = [metadata.version(name) for name in ("sympy", "casadi", "numpy")]
        return canonical_hash([model_hash(self.document), files, versions])

    @cached_property
    def derivation(self) -> Derivation:
        """The symbolic reference, freshly derived."""
        return derive(self.model, self.stage)

    @cached_property
    def manifest(self) -> Manifest:
        """The manifest of the generated folder; raises `StaleError` if it cannot be trusted."""
        from pmjoint_codegen.provision import with_data

        return with_data(Manifest.read(self.folder), self.document, self.file)

    @cached_property
    def table(self) -> Mapping[str, Kernel]:
        """Meaning of every kernel except the Taylor ones, in symbols."""
        return {kernel.name: kernel for kernel in kernel_table(self.derivation)}

    @cached_property
    def features(self) -> Features:
        """Where the model's functions are of order one."""
        words = vocabulary(self.derivation)
        return Features.of(self.derivation, words.p, words.x)

    @cached_property
    def tapes(self) -> Mapping[str, Tape]:
        """The emitted instructions of every kernel, from ``kernels.tape``."""
        return read_tapes((self.folder / FILE_NAME).read_text(encoding="utf-8"))

    @cached_property
    def compiler(self) -> Compiler | None:
        """The compiler that a run would use."""
        return find_compiler(self.environment, self.notify)

    @cached_property
    def compiled(self) -> Evaluator | None:
        """The generated C, compiled as for a run; None without a compiler."""
        if self.compiler is None:
            return None
        cache = cache_dir(self.environment, self.notify)
        levels = usable_levels(self.environment)
        return compiled.load(self.folder, self.manifest, self.compiler, cache, levels)

    @cached_property
    def interpreted(self) -> Evaluator:
        """The emitted functions in CasADi's interpreter."""
        return interpreted.load(self.folder, self.manifest)

    def points(self, function: Function, count: int, seed: int) -> list[Batch]:
        """Points of a kernel at magnitudes of a run, with y in the range that the design is for."""
        return batches(
            self.interpreted,
            function,
            count,
            seed,
            extreme=False,
            features=self.features,
            y_range=self.model.y_range,
        )

    @cached_property
    def fed(self) -> tuple[bytes, bytes]:
        """What the program of `harness` reads, and the interpreter's answers."""
        return harness.feed(self.interpreted)


def load_subject(
    file: Path, environment: Mapping[str, str], notify: Notify, stage: Stage = unwatched
) -> Subject:
    """Read a model file and find its generated folder.

    Raises:
        ModelError: for a model that cannot be read or is outside the class.
    """
    from pmjoint_codegen.modelfile import model_of
    from pmjoint_codegen.modelfile.reader import read_document

    document: dict[str, Any] = read_document(file)
    model = model_of(document, str(file))
    return Subject(file, document, model, generated_root(file) / model.name, environment, notify, stage)
