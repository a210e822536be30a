"""The batch loops as a program: on another processor and under sanitizers, with the same bits."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.compile.library import FLAGS
from pmjoint_codegen.kernels.processor import Level, known_levels, usable_levels
from pmjoint_codegen.loops import batch
from pmjoint_codegen.loops.batch import BatchLibrary, Runs, step_rules
from pmjoint_codegen.loops.logits import reach_of
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.values import SETTLED

from .conftest import library, make_runs, sampled

EMULATOR = "qemu-aarch64"
FOR_ARM64 = ("aarch64-linux-gnu-gcc", f"-DPMJ_WIDTH={known_levels()[-1].width}", "-static")
LONG = "lag-adaptive"  # whose lanes compile for a minute; the other adaptive models have its operations
MODELS = sorted(
    folder.name
    for folder in (Path(__file__).parents[2] / "generated").iterdir()
    if folder.is_dir() and folder.name != LONG
)

needs_arm64 = pytest.mark.skipif(
    not (shutil.which(FOR_ARM64[0]) and shutil.which(EMULATOR)),
    reason="apt-get install gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user",
)


def as_program(root: Path, model: str, folder: Path, *compiler: str) -> Path:
    """The batch loops of a model as a program of their own."""
    sources = batch.batch_sources(root / "generated" / model)
    sources["main.c"] = Path(__file__).with_name("batch_program.c").read_bytes()
    for name, content in sources.items():
        (folder / name).write_bytes(content)
    units = sorted(name for name in sources if name.endswith(".c"))
    own = [flag for flag in FLAGS if flag not in ("-fPIC", "-shared")]
    first, *more = compiler
    subprocess.run([first, *own, *more, *units, "-o", "batch", "-lm"], cwd=folder, check=True)
    return folder / "batch"


def answer(manifest: Manifest, runs: Runs, *command: str | Path) -> bytes:
    """What the program answers: metrics, final states, trajectories."""
    sizes = [len(runs.x0), len(runs.times), runs.x0.shape[1], runs.p.shape[1], *runs.hold.shape[::-1]]
    rules = step_rules(manifest, runs)
    numbers = [runs.horizon, runs.sample_time, runs.tolerance, runs.divergence, runs.max_steps]
    numbers += [runs.max_step, SETTLED, rules.lebesgue]
    lengths = [len(rules.inside), len(rules.ratios), len(rules.hold_ratios)]
    steps = (rules.inside, rules.ratios, rules.factors, rules.hold_ratios, rules.hold_rate_factors)
    parts = (
        *(np.array(sizes, dtype=np.int64), np.array(numbers), np.array(lengths, dtype=np.float64), *steps),
        *(
            rules.hold_value_factors,
            runs.x0,
            runs.p,
            runs.hold,
            reach_of(manifest, runs.divergence),
            runs.times,
        ),
    )
    given = b"".join(part.tobytes() for part in parts)
    # The program ends without freeing what it asked for; the loops themselves allocate nothing.
    settings = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0"}
    done = subprocess.run(command, input=given, stdout=subprocess.PIPE, check=True, env=settings)
    return done.stdout


def native(library: BatchLibrary, runs: Runs) -> bytes:
    outcome = library.simulate(runs)
    return b"".join(part.tobytes() for part in (outcome.metrics, outcome.final, outcome.trajectories))


def without_signs(answered: bytes) -> bytes:
    """The same with one NaN for all: a new one has a sign bit on x86-64, and none on ARM."""
    numbers = np.frombuffer(answered, dtype=np.float64).copy()
    numbers[np.isnan(numbers)] = np.nan
    return numbers.tobytes()


@needs_arm64
@pytest.mark.parametrize("model", MODELS)
def test_arm64_gives_the_same_bits(root: Path, cache: Path, model: str, tmp_path: Path) -> None:
    one, program = (
        library(root, cache, model, known_levels()[0].name),
        as_program(root, model, tmp_path, *FOR_ARM64),
    )
    runs = make_runs(one, 7, horizon=0.5, times=np.linspace(0.0, 0.5, 6))
    for kind in (runs, sampled(one, runs, 0.001)):
        found, wanted = answer(one.manifest, kind, EMULATOR, program), native(one, kind)
        assert without_signs(found) == without_signs(wanted)


@needs_arm64
def test_arm64_would_not_with_fused_operations(root: Path, cache: Path, tmp_path: Path) -> None:
    one = library(root, cache, "paper", known_levels()[0].name)
    program = as_program(root, "paper", tmp_path, *FOR_ARM64, "-ffp-contract=fast")
    runs = make_runs(one, 7, horizon=0.5)
    assert answer(one.manifest, runs, EMULATOR, program) != native(one, runs)


@pytest.mark.parametrize("level", usable_levels({}), ids=lambda level: level.name)
def test_sanitizers_find_nothing_and_the_bits_are_the_same(
    root: Path, cache: Path, tmp_path: Path, level: Level
) -> None:
    """Runs of every kind: one diverges, one overflows, one has no step left, rows and samples do not meet."""
    if shutil.which("gcc") is None:
        pytest.skip("no gcc")
    one = library(root, cache, "joint-exact", level.name)
    width = (*level.flags, f"-DPMJ_WIDTH={level.width}", "-g")
    watch = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    try:
        program = as_program(root, "joint-exact", tmp_path, "gcc", *width, *watch)
    except subprocess.CalledProcessError:
        pytest.skip("no sanitizer library")
    runs = make_runs(one, 19, horizon=0.5, times=np.linspace(0.0, 0.5, 8), max_steps=400)
    runs.x0[3, 0], runs.x0[11, 0] = 1e7, 1e302
    for kind in (runs, sampled(one, runs, 0.003)):
        assert answer(one.manifest, kind, program) == native(one, kind)
