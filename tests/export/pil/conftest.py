"""Folders of emulated processors, each built once."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.errors import MissingToolError
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.pil.chips import Chip, chip_named
from pmjoint_codegen.export.pil.folder import Columns, folder_files
from pmjoint_codegen.export.pil.machine import Tools
from pmjoint_codegen.export.pil.records import Answer, Array, Layout

PRECISIONS = ("double", "float")


@dataclass(frozen=True)
class Built:
    """A folder that has been built."""

    chip: Chip
    tools: Tools
    folder: Path
    exports: dict[str, Export]

    def layout(self, precision: str) -> Layout:
        """The records of a precision."""
        export = self.exports[precision]
        return Layout.of(Columns.of(export.program), export.precision)

    def emulated(self, precision: str, given: Array) -> Answer:
        """The processor's answers."""
        return self.tools.emulated(self.folder / precision).recorded(given, self.layout(precision))

    def native(self, precision: str, given: Array) -> Answer:
        """This machine's answers."""
        return self.tools.native(self.folder / precision).recorded(given, self.layout(precision))


def tools_of(chip: str) -> Tools:
    """The tools of a chip, or a skipped test."""
    try:
        return Tools.find(chip_named(chip), os.environ)
    except MissingToolError as error:
        pytest.skip(str(error))


def samples(export: Export, count: int) -> Array:
    """Inputs that swing, so far that v meets its limits."""
    t = 0.01 * np.arange(count)
    orders = range(len(Columns.of(export.program).given) - 1)
    reference = [2.0 * 3.0**order * np.cos(3.0 * t + 1.6 * order) for order in orders]
    return np.column_stack([0.4 * np.sin(2.0 * t), *reference])


@pytest.fixture(scope="session")
def built(
    exports: Callable[..., Export], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str, str], Built]:
    """Build the folder of a model on a chip."""

    def make(model: str, chip: str) -> Built:
        tools = tools_of(chip)
        both = {precision: exports(model, precision) for precision in PRECISIONS}
        folder = tmp_path_factory.mktemp(f"{model}-{chip}")
        write(folder, folder_files(tools.chip, both.values()))
        tools.build(folder)
        return Built(tools.chip, tools, folder, both)

    return cache(make)


def write(folder: Path, files: dict[str, str]) -> None:
    """Write an export."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


@pytest.fixture
def changed(tmp_path: Path) -> Callable[[Built, str, str, str], Built]:
    """Copy a built folder with one text replaced in one file, and build it again."""

    def make(original: Built, file: str, old: str, new: str) -> Built:
        folder = tmp_path / "changed"
        shutil.copytree(original.folder, folder)
        text = (folder / file).read_text(encoding="utf-8")
        assert text.count(old) == 1, file
        (folder / file).write_text(text.replace(old, new), encoding="utf-8")
        for image in folder.glob("*/pil.elf"):
            image.unlink()
        for item in (*folder.glob("*/*.o"), *folder.glob("*.o")):
            item.unlink()
        original.tools.build(folder)
        return Built(original.chip, original.tools, folder, original.exports)

    return make
