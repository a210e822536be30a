"""The data that a process needs to compute: the manifest and the C sources, small enough to send.

Each process compiles for the vectors of its own machine, into its own cache folder; results are the same
everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pmjoint_codegen.brief import brief
from pmjoint_codegen.compile.compiler import LOOKED_FOR, find_compiler, install_line
from pmjoint_codegen.errors import MissingToolError
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.loops.batch import BatchLibrary, batch_sources, load
from pmjoint_codegen.manifest import FILE_NAME, Manifest
from pmjoint_codegen.workspace import cache_dir


@dataclass(frozen=True)
class BuildInputs:
    """A model, ready to be sent and built.

    Attributes:
        manifest: text of ``model.json``.
        sources: (file name, text) of all compiled files.
    """

    manifest: str
    sources: tuple[tuple[str, str], ...]

    __repr__ = brief


def make_inputs(folder: Path) -> BuildInputs:
    """Pack the kernels of a model.

    Args:
        folder: holds ``model.json``, ``lanes.c`` and ``lanes.h``.

    Raises:
        StaleError: a generated file is missing.
    """
    sources = batch_sources(folder)
    text = (folder / FILE_NAME).read_text(encoding="utf-8")
    return BuildInputs(text, tuple((name, content.decode()) for name, content in sorted(sources.items())))


def library_of(inputs: BuildInputs, environment: Mapping[str, str]) -> BatchLibrary:
    """The library of some inputs, built for this machine or reused from its cache folder.

    Args:
        inputs: the model.
        environment: for the compiler, the cache folder and the vector level.

    Raises:
        MissingToolError: no compiler here.
        BuildError: the compiler failed.
    """
    compiler = find_compiler(environment)
    if compiler is None:
        raise MissingToolError(
            f"a sweep needs a C compiler ({LOOKED_FOR})", remedy=f"install one: {install_line()}"
        )
    manifest = Manifest.from_json(inputs.manifest, FILE_NAME)
    sources = {name: text.encode() for name, text in inputs.sources}
    return load(sources, manifest, usable_levels(environment), compiler, cache_dir(environment))
