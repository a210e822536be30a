"""The exported controller, a step of it, against one written by hand for the same model."""

from __future__ import annotations

import ctypes
import os
import subprocess
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.clock import interleaved
from benchmarks.peers.by_hand import parameters
from benchmarks.reference import ROOT
from benchmarks.report import Row, Section
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.export.package import export_c
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_derive import derive

FLAGS: Final = ("-O2", "-std=c99", "-fPIC", "-shared")  # those of the exported Makefile
ROWS: Final = 20_000
AGREEMENT: Final = 1e-9  # relative to the largest |v|
SAMPLE_TIME: Final = 1e-3  # s


def run(quick: bool, folder: Path) -> Section:
    """Measure; build both in `folder`."""
    section = Section(
        "Exported controller, one step",
        "The paper's controller in double precision: of `pmjoint export paper --target c`, and in C written "
        "by hand for this one model; both with -O2 -std=c99, as in the exported Makefile. Both compute "
        "filters, compensator, law, limits, estimate and errors. The exported step also checks its inputs, "
        "and v, and takes a measured u.",
    )
    try:
        library = _built(folder)
    except OSError as error:
        section.absent.append(str(error))
        return section
    t = np.arange(ROWS) * SAMPLE_TIME
    rows = np.ascontiguousarray(np.stack([np.cos(3 * t), np.sin(t), np.cos(t), -np.sin(t)], axis=1))
    rows[0] = 0.0  # the hand-written step has no first sample: it begins with a hold at rest
    ours, theirs = np.empty(ROWS), np.empty(ROWS)
    evaluator = ClosedLoop.load("paper", evaluator="compiled").evaluator
    hold = hold_matrices(evaluator, make_settings(evaluator.manifest).p, SAMPLE_TIME)
    p, count = parameters(1)[0], ctypes.c_longlong(ROWS)

    def exported() -> None:
        library.exported_many(_pointer(rows), _pointer(ours), count)

    def by_hand() -> None:
        library.by_hand_many(_pointer(rows), _pointer(theirs), count, _pointer(p), _pointer(hold))

    times = interleaved({"ours": exported, "by hand": by_hand}, 3 if quick else 101)
    if not np.abs(ours - theirs).max() <= AGREEMENT * np.abs(theirs).max():
        raise SystemExit("benchmarks: the exported controller and the one by hand compute another v")
    section.add(Row("one step", times["ours"] / ROWS, "C by hand", times["by hand"] / ROWS, 1.2))
    return section


def _built(folder: Path) -> Any:
    file = ROOT / "models" / "paper.toml"
    export = export_c(derive(model_of(read_document(file), str(file))), Identity("paper", "", ""))
    for name in ("pmjoint_paper.c", "pmjoint_paper.h"):
        (folder / name).write_text(export.files[name], encoding="utf-8")
    here = Path(__file__).resolve().parent / "c"
    units = [folder / "pmjoint_paper.c", here / "controller_by_hand.c", here / "exported_driver.c"]
    target = folder / "exported.so"
    compiler = os.environ.get("CC", "cc").split()
    command = [*compiler, *FLAGS, f"-I{folder}", *map(str, units), "-o", str(target), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"the exported C does not compile here: {done.stderr.splitlines()[-1:]}")
    return ctypes.CDLL(str(target))


def _pointer(array: np.ndarray[Any, Any]) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
