"""Compiled and interpreted kernels: the same bits, the same refusals."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.errors import BuildError, SimulationError, StaleError, UsageError
from pmjoint_codegen.kernels import compiled, interpreted
from pmjoint_codegen.kernels.declarations import declarations, load_module, to_module
from pmjoint_codegen.kernels.evaluator import Evaluator, PreparingEvaluator
from pmjoint_codegen.kernels.processor import known_levels
from pmjoint_codegen.loops import batch
from pmjoint_codegen.manifest import Manifest

C_SOURCES = Path(compiled.__file__).parents[1] / "loops" / "c"


@pytest.fixture(scope="session")
def folder(root: Path) -> Path:
    return root / "generated" / "paper"


@pytest.fixture(scope="session")
def manifest(folder: Path) -> Manifest:
    return Manifest.read(folder)


@pytest.fixture(scope="session")
def fast(folder: Path, manifest: Manifest, cache: Path) -> compiled.CompiledEvaluator:
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    return compiled.load(folder, manifest, compiler, cache)


@pytest.fixture(scope="session")
def slow(folder: Path, manifest: Manifest) -> interpreted.InterpretedEvaluator:
    pytest.importorskip("casadi")
    return interpreted.load(folder, manifest)


def test_every_kernel_gives_the_same_bits_compiled_and_interpreted(
    manifest: Manifest, fast: Evaluator, slow: Evaluator
) -> None:
    draw = np.random.default_rng(20)
    for function in manifest.functions:
        inputs = [draw.normal(scale=3.0, size=(50, size)) for _, size in function.inputs]
        for one, other in zip(
            fast.call(function.name, *inputs), slow.call(function.name, *inputs), strict=True
        ):
            np.testing.assert_array_equal(one, other, err_msg=function.name)


@pytest.mark.parametrize("kind", ["fast", "slow"])
def test_one_point_and_rows_and_broadcasting_agree(kind: str, request: pytest.FixtureRequest) -> None:
    evaluator: Evaluator = request.getfixturevalue(kind)
    draw = np.random.default_rng(3)
    y, s = draw.normal(size=(4, 1, 1)), draw.normal(size=(5, 8))
    y_r, p = draw.normal(size=3), draw.uniform(1.0, 2.0, size=15)
    z, alpha, v = evaluator.call("law", y, s, y_r, p)
    assert (z.shape, alpha.shape, v.shape) == ((4, 5, 2), (4, 5, 1), (4, 5, 1))
    point = evaluator.kernel("law")
    for i in range(4):
        for j in range(5):
            np.testing.assert_array_equal(v[i, j], point(y[i, 0], s[j], y_r, p)[2])
    assert evaluator.call("law", np.empty((0, 1)), s[0], y_r, p)[2].shape == (0, 1)


@pytest.mark.parametrize("kind", ["fast", "slow"])
def test_wanted_results_are_those_of_the_whole_call(kind: str, request: pytest.FixtureRequest) -> None:
    evaluator: PreparingEvaluator = request.getfixturevalue(kind)
    draw = np.random.default_rng(4)
    given = [draw.normal(size=(6, size)) for _, size in evaluator.manifest.function("law").inputs]
    z, alpha, v = evaluator.call("law", *given)
    for wanted, expected in ((("v",), [v]), (("z", "v"), [z, v]), (("alpha",), [alpha]), ((), [])):
        found = evaluator.call("law", *given, results=wanted)
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, other)
    with pytest.raises(UsageError, match="gives no w; it gives: z, alpha, v"):
        evaluator.call("law", *given, results=("v", "w"))
    assert evaluator.call("law", *(rows[:0] for rows in given), results=("v",))[0].shape == (0, 1)


@pytest.mark.parametrize("kind", ["fast", "slow"])
def test_a_prepared_kernel_reads_and_writes_its_own_arrays(kind: str, request: pytest.FixtureRequest) -> None:
    evaluator: PreparingEvaluator = request.getfixturevalue(kind)
    draw = np.random.default_rng(5)
    for function in evaluator.manifest.functions:
        one, other = evaluator.prepare(function.name), evaluator.prepare(function.name)
        assert [len(array) for array in one.inputs] == [size for _, size in function.inputs]
        for _ in range(3):
            for prepared in (one, other):
                for array in prepared.inputs:
                    array[:] = draw.normal(size=len(array))
            one.run()
            other.run()
            for prepared in (one, other):
                for found, expected in zip(
                    prepared.outputs, evaluator.call(function.name, *prepared.inputs), strict=True
                ):
                    np.testing.assert_array_equal(found, expected, err_msg=function.name)
    with pytest.raises(UsageError, match="no kernel is called"):
        evaluator.prepare("lew")


def test_a_prepared_kernel_that_fails_says_so(fast: compiled.CompiledEvaluator) -> None:
    class Failing:
        pmj_apply = staticmethod(lambda kernel: 3)

        def __getattr__(self, name: str) -> object:
            return getattr(fast.lib, name)

    broken = compiled.CompiledEvaluator(fast.manifest, fast.ffi, Failing())
    with pytest.raises(SimulationError, match="kernel law reported failure 3"):
        broken.prepare("law").run()


@pytest.mark.parametrize("kind", ["fast", "slow"])
def test_results_of_two_calls_do_not_share_memory(kind: str, request: pytest.FixtureRequest) -> None:
    evaluator: Evaluator = request.getfixturevalue(kind)
    point = evaluator.kernel("filter_matrix")
    p = np.ones(15)
    (first,) = point(p)
    kept = first.copy()
    point(p * 5.0)
    np.testing.assert_array_equal(first, kept)


@pytest.mark.parametrize("kind", ["fast", "slow"])
@pytest.mark.parametrize(
    ("name", "shapes", "part"),
    [
        ("lew", [], "law"),
        ("reference", [(1,)], "2 arguments"),
        ("reference", [(1,), (11,)], "(..., 15)"),
        ("reference", [(), (15,)], "(..., 1)"),
        ("reference", [(3, 1), (4, 15)], "broadcast"),
    ],
)
def test_misuse_is_refused(
    kind: str, name: str, shapes: list[tuple[int, ...]], part: str, request: pytest.FixtureRequest
) -> None:
    evaluator: Evaluator = request.getfixturevalue(kind)
    with pytest.raises(UsageError) as caught:
        evaluator.call(name, *(np.zeros(shape) for shape in shapes))
    assert part in str(caught.value)


def test_a_missing_or_incomplete_generated_file_is_stale(
    manifest: Manifest, root: Path, tmp_path: Path
) -> None:
    compiler = find_compiler(os.environ)
    if compiler is not None:
        with pytest.raises(StaleError):
            compiled.load(tmp_path, manifest, compiler, tmp_path)
        (tmp_path / "kernels.c").write_text("int pmjoint_law(void);\nint pmjoint_law(void) { return 0; }\n")
        (tmp_path / "kernels.h").write_text("int pmjoint_law(void);\n")
        for name in ("loops.c", "sampled.h"):
            with pytest.raises(StaleError, match=re.escape(name)):
                compiled.load(tmp_path, manifest, compiler, tmp_path / "cache")
            shutil.copy(root / "generated" / "paper" / name, tmp_path)
        with pytest.raises(StaleError, match="reference"):
            compiled.load(tmp_path, manifest, compiler, tmp_path / "cache")
    for text in (None, "law y[1] -> v[1]\n0 input", "law y[1] -> v[1]\n0 input 0 0\noutput 0 0 0\n"):
        if text is not None:
            (tmp_path / "kernels.tape").write_text(text)
        with pytest.raises(StaleError):
            interpreted.load(tmp_path, manifest)


def test_what_cannot_be_loaded_here_is_refused_with_the_loaders_words(
    folder: Path, manifest: Manifest, root: Path, tmp_path: Path
) -> None:
    script = tmp_path / "cross-compiler"
    script.write_text('#!/bin/sh\nwhile [ "$1" != -o ]; do shift; done\necho for another machine > "$2"\n')
    script.chmod(0o755)
    compiler = find_compiler({"CC": str(script), "PATH": os.environ["PATH"]})
    assert compiler is not None
    sources = batch.batch_sources(root / "generated" / "paper")
    for load in (
        lambda: compiled.load(folder, manifest, compiler, tmp_path),
        lambda: batch.load(sources, manifest, known_levels()[-1:], compiler, tmp_path),
    ):
        with pytest.raises(BuildError, match=r"cross-compiler: .* cannot be loaded here; .*CC=") as caught:
            load()
        assert "kernels.so" in caught.value.output


def test_declarations_survive_as_python_text() -> None:
    kernels = "/* int gone(void); */\n#define X 1\nint pmjoint_law(int);\n int pmjoint_law_work(int);\n"
    kernels += "int pmjoint_plant(int\n b);\n"
    loops = "#if 1\ntypedef struct { long long n; } thing; /* x */\n#endif\n"
    text = declarations(kernels, loops, ["plant", "law"])
    assert "gone" not in text
    assert "law_work" not in text
    ffi = load_module(to_module(text))
    assert ffi.sizeof("thing") == 8


def test_to_module_keeps_standard_output_clean(capsys: pytest.CaptureFixture[str]) -> None:
    to_module("int law(void);")
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("source", sorted(path.name for path in C_SOURCES.glob("*.c")))
def test_the_loops_are_strict_c99(compiler: str, source: str, root: Path, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler}")
    warnings = ("all", "extra", "pedantic", "conversion", "shadow", "missing-prototypes", "error")
    flags = ["-O2", "-std=c99", *(f"-W{name}" for name in warnings)]
    flags += ["-I", str(root / "generated" / "joint-lag")]  # its sampled.h has more than one w
    command = [compiler, *flags, "-c", str(C_SOURCES / source), "-o", str(tmp_path / "unit.o")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_loops_neither_allocate_nor_keep_state() -> None:
    text = "\n".join(path.read_text() for path in C_SOURCES.glob("*.c"))
    for word in ("malloc", "calloc", "realloc", "alloca", "free("):
        assert word not in text
    assert re.findall(r"^\s*static\s[^(]*[;=]", text, re.MULTILINE) == []
