from __future__ import annotations

import ctypes
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pmjoint_codegen.compile.compiler import Compiler, find_compiler
from pmjoint_codegen.compile.library import FLAGS, HASHES, LIBRARY, build, build_key, is_sound
from pmjoint_codegen.errors import BuildError

from .conftest import Counter

SOURCES = {
    "answer.c": b'#include "answer.h"\nint answer(void) { return ANSWER; }\n',
    "answer.h": b"#define ANSWER 42\n",
}
Make = Callable[..., Counter]


def answer(folder: Path) -> int:
    return int(ctypes.CDLL(str(folder / LIBRARY)).answer())


def test_builds_once_and_then_reuses(tmp_path: Path, counting: Make) -> None:
    counter = counting()
    folders = {build(SOURCES, counter.compiler, tmp_path) for _ in range(3)}
    assert len(folders) == 1
    assert answer(folders.pop()) == 42
    assert counter.calls == 1


def test_extras_are_kept_beside_the_library_and_made_only_with_it(tmp_path: Path, counting: Make) -> None:
    counter = counting()
    made = []
    for _ in range(2):
        folder = build(SOURCES, counter.compiler, tmp_path, lambda: made.append(1) or {"note": b"text"})  # type: ignore[func-returns-value]
    assert (folder / "note").read_bytes() == b"text"
    assert len(made) == 1


@pytest.mark.parametrize("name", [LIBRARY, "note", HASHES])
@pytest.mark.parametrize("harm", ["change", "truncate", "delete"])
def test_a_damaged_build_is_made_again(tmp_path: Path, counting: Make, name: str, harm: str) -> None:
    counter = counting()
    folder = build(SOURCES, counter.compiler, tmp_path, lambda: {"note": b"text"})
    damaged = folder / name
    content = damaged.read_bytes()
    if harm == "delete":
        damaged.unlink()
    else:
        damaged.write_bytes(content[:-1] if harm == "truncate" else content.replace(content[1:2], b"#"))
    assert not is_sound(folder)
    assert build(SOURCES, counter.compiler, tmp_path, lambda: {"note": b"text"}) == folder
    assert is_sound(folder)
    assert answer(folder) == 42
    assert counter.calls == 2


def test_key_follows_sources_flags_and_compiler(counting: Make) -> None:
    compiler = counting().compiler
    changed_source = {**SOURCES, "answer.h": b"#define ANSWER 43\n"}
    moved = {"answer.c": SOURCES["answer.c"] + SOURCES["answer.h"], "answer.h": b""}
    keys = {
        build_key(SOURCES, compiler),
        build_key(changed_source, compiler),
        build_key(moved, compiler),
        build_key(SOURCES, Compiler((*compiler.command, "-g"), compiler.identity)),
        build_key(SOURCES, Compiler(compiler.command, compiler.identity + "0")),
    }
    assert len(keys) == 5
    assert build_key(dict(reversed(SOURCES.items())), compiler) == build_key(SOURCES, compiler)


def test_a_failing_compiler_is_quoted_whole_and_leaves_nothing(tmp_path: Path, counting: Make) -> None:
    broken = {"broken.c": b"int a(void) { return first_mistake; }\nint b(void) { return second_mistake; }\n"}
    with pytest.raises(BuildError) as caught:
        build(broken, counting().compiler, tmp_path / "cache-that-is-made")
    assert "first_mistake" in caught.value.output
    assert "second_mistake" in caught.value.output
    assert "\n" not in str(caught.value)
    assert list((tmp_path / "cache-that-is-made").iterdir()) == []


def test_a_compiler_that_succeeds_without_a_library_is_a_failure(tmp_path: Path) -> None:
    with pytest.raises(BuildError):
        build(SOURCES, Compiler(("/bin/true",), "true"), tmp_path)


def test_a_link_in_place_of_a_build_is_not_followed(tmp_path: Path, counting: Make) -> None:
    compiler = counting("cc").compiler
    precious, cache = tmp_path / "precious", tmp_path / "cache"
    precious.mkdir()
    cache.mkdir()
    (precious / "file").write_text("kept")
    (cache / build_key(SOURCES, compiler)).symlink_to(precious)
    assert answer(build(SOURCES, compiler, cache)) == 42
    assert [file.name for file in precious.iterdir()] == ["file"]


def _build_in_child(compiler: Compiler, cache: Path, barrier: object, results: object) -> None:
    barrier.wait()  # type: ignore[attr-defined]
    results.put(answer(build(SOURCES, compiler, cache)))  # type: ignore[attr-defined]


def test_eight_processes_may_build_at_once(tmp_path: Path, counting: Make) -> None:
    context = multiprocessing.get_context("spawn")
    barrier, results = context.Barrier(8), context.Queue()
    arguments = (counting("sleep 0.2").compiler, tmp_path / "cache", barrier, results)
    children = [context.Process(target=_build_in_child, args=arguments) for _ in range(8)]
    for child in children:
        child.start()
    assert [results.get(timeout=60) for _ in children] == [42] * 8
    for child in children:
        child.join(timeout=60)
        assert child.exitcode == 0
    left = [path.name for path in (tmp_path / "cache").iterdir()]
    assert left == [build_key(SOURCES, arguments[0])]


def test_a_build_killed_in_the_middle_leaves_no_broken_library(tmp_path: Path, counting: Make) -> None:
    slow = counting("sleep 30")
    cache = tmp_path / "cache"
    script = (
        "from pathlib import Path; from pmjoint_codegen.compile.compiler import Compiler;"
        "from pmjoint_codegen.compile.library import build;"
        f"build({SOURCES!r}, {slow.compiler!r}, Path({str(cache)!r}))"
    )
    child = subprocess.Popen([sys.executable, "-c", script], start_new_session=True)
    deadline = time.monotonic() + 30
    while not slow.calls:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    key = build_key(SOURCES, slow.compiler)
    assert not (cache / key).exists()
    fast = counting()
    assert answer(build(SOURCES, fast.compiler, cache)) == 42


def test_what_killed_builds_left_is_removed_after_a_day_and_nothing_else(
    tmp_path: Path, counting: Make
) -> None:
    old, young, other = (tmp_path / name for name in (".build-old", ".build-young", "somebody's"))
    for folder in (old, young, other):
        folder.mkdir()
        (folder / "half.c").write_text("int a")
    (tmp_path / ".build-elsewhere").symlink_to(other)
    for folder in (old, other):
        os.utime(folder, (0, time.time() - 25 * 3600))
    os.utime(tmp_path / ".build-elsewhere", (0, 0), follow_symlinks=False)
    os.utime(young, (0, time.time() - 3600))
    assert answer(build(SOURCES, counting().compiler, tmp_path)) == 42
    assert not old.exists()
    assert (young / "half.c").is_file()
    assert (other / "half.c").is_file()


HERE = tuple(name for name in ("gcc", "clang") if shutil.which(name))
FREE_WITH_RESULTS = ("-ffast-math", "-Ofast", "-funsafe-math-optimizations", "-ffinite-math-only")
SUMS = {
    "sums.c": b"double lost(double one, double half);\n"
    b"double lost(double one, double half) { return ((one + half) + half) - one; }\n"
}


def compiler_of(command: str) -> Compiler:
    found = find_compiler({"CC": command, "PATH": os.environ["PATH"]})
    assert found is not None
    assert found.command[1:]
    return found


@pytest.mark.parametrize("program", HERE)
@pytest.mark.parametrize("flag", FREE_WITH_RESULTS)
def test_flags_of_cc_change_neither_results_nor_how_the_process_computes(
    tmp_path: Path, program: str, flag: str
) -> None:
    folder = build(SUMS, compiler_of(f"{program} {flag}"), tmp_path)
    script = (
        "import ctypes, sys; lost = ctypes.CDLL(sys.argv[1]).lost;"
        "lost.restype, lost.argtypes = ctypes.c_double, [ctypes.c_double] * 2;"
        "print(lost(1.0, 2.0**-53), sys.float_info.min * 0.25 > 0.0)"
    )
    command = [sys.executable, "-c", script, str(folder / LIBRARY)]
    assert subprocess.run(command, capture_output=True, check=True, text=True).stdout == "0.0 True\n"


@pytest.mark.skipif("gcc" not in HERE, reason="a flag of gcc")
def test_what_cannot_be_taken_back_is_refused_by_what_it_does(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match="another precision") as caught:
        build(SUMS, compiler_of("gcc -fsingle-precision-constant"), tmp_path)
    assert "-fsingle-precision-constant" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("program", HERE)
def test_every_broken_promise_is_found(tmp_path: Path, program: str) -> None:
    """Flags behind our own win: then the self-test alone stands between them and a result."""
    faults = {
        "-fassociative-math -fno-signed-zeros -freciprocal-math": ("another order", "reciprocals"),
        "-mfma -ffp-contract=fast": ("contracts",),
        "-ffast-math": ("denormal", "infinities"),
    }
    for flags, words in faults.items():
        with pytest.raises(BuildError) as caught:
            build(SUMS, compiler_of(f"{program} -g"), tmp_path, flags=(*FLAGS, *flags.split()))
        for word in words:
            assert word in str(caught.value), flags


def test_a_library_that_ends_whoever_loads_it_ends_another_process(tmp_path: Path, counting: Make) -> None:
    deadly = {
        "end.c": b"#include <stdlib.h>\n"
        b"__attribute__((constructor)) static void end(void);\nstatic void end(void) { abort(); }\n"
    }
    with pytest.raises(BuildError, match="cannot be loaded"):
        build(deadly, counting().compiler, tmp_path)


def test_a_compiler_that_hangs_is_ended_with_all_it_started(tmp_path: Path, counting: Make) -> None:
    note = tmp_path / "child"
    slow = counting(f'sleep 300 & echo $! > "{note}"; wait')
    started = time.monotonic()
    with pytest.raises(BuildError, match=r"did not end within 0\.5 s"):
        build(SOURCES, slow.compiler, tmp_path / "cache", patience=0.5)
    assert time.monotonic() - started < 30
    child = Path("/proc") / note.read_text().strip() / "stat"
    deadline = time.monotonic() + 10
    while child.exists() and child.read_text().rpartition(")")[2].split()[0] != "Z":
        assert time.monotonic() < deadline
        time.sleep(0.01)
