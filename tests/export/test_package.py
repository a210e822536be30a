"""The exported folder: it builds without a warning under every compiler here, tests itself and runs."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import mpmath
import numpy as np
import pytest

from pmjoint_codegen.check.gates.compilers import recursion_faults
from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.export.package import Export

FILES = {"Makefile", "README.md", "CMakeLists.txt", "main.c", "trace.json"}
FILES |= {"library.properties", "library.json", "analyse.c"}
STRICT = "-O2 -std=c99 -Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wshadow -Wmissing-prototypes"
REAL = ("laas-axis", "maglev")  # of the gallery: a joint with a lag, and a plant by its own states
LEARNERS = ("paper-adaptive", "squares", "first-order")
KNOWERS = ("paper", "joint-exact", "joint-lag", "third-order", "braking", "chain", "third-nonlinear", *REAL)
MODELS = (*KNOWERS, *LEARNERS)


def written(export: Export, folder: Path) -> Path:
    """Write an export's files."""
    for name, text in export.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("name", MODELS)
def test_make_test_holds(
    name: str, compiler: str, precision: str, exports: Callable[..., Export], tmp_path: Path
) -> None:
    if shutil.which(compiler) is None or shutil.which("make") is None:
        pytest.skip(f"no {compiler}, or no make")
    export = exports(name, precision)
    assert export.files.keys() == FILES | {f"{export.identity.prefix}.{end}" for end in "ch"}
    done = subprocess.run(
        ["make", "-C", str(written(export, tmp_path)), "test", f"CC={compiler}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "all holds" in done.stdout


def test_make_test_fails_where_the_self_test_does(exports: Callable[..., Export], tmp_path: Path) -> None:
    if shutil.which("make") is None or shutil.which("cc") is None:
        pytest.skip("no make or compiler")
    export = exports("paper")
    written(export, tmp_path)
    source = tmp_path / f"{export.identity.prefix}.c"
    source.write_text(export.source.replace("params->b0 = 2.0", "params->b0 = 2.002"), encoding="utf-8")
    done = subprocess.run(["make", "-C", str(tmp_path), "test"], capture_output=True, check=False)
    assert done.returncode != 0


def test_cmake_builds_and_tests_it(exports: Callable[..., Export], tmp_path: Path) -> None:
    if any(shutil.which(tool) is None for tool in ("cmake", "ctest", "cc")):
        pytest.skip("no cmake or compiler")
    folder = written(exports("paper"), tmp_path)
    for command in (
        ["cmake", "-S", ".", "-B", "build", f"-DCMAKE_C_FLAGS={STRICT} -Werror"],
        ["cmake", "--build", "build"],
        ["ctest", "--test-dir", "build", "--output-on-failure", "--no-tests=error"],
    ):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "100% tests passed" in done.stdout


@pytest.mark.parametrize("precision", ["double", "float"])
def test_zig_builds_it_without_a_warning(
    precision: str, exports: Callable[..., Export], tmp_path: Path
) -> None:
    pytest.importorskip("ziglang")
    export = exports("joint-exact", precision)
    folder = written(export, tmp_path)
    units = [f"{export.identity.prefix}.c", "main.c"]
    build = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        *STRICT.split(),
        "-Werror",
        *units,
        "-o",
        "example",
        "-lm",
    ]
    done = subprocess.run(build, cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    ran = subprocess.run([folder / "example"], capture_output=True, text=True, check=False)
    assert ran.returncode == 0 and "all holds" in ran.stdout


def test_the_folder_is_a_library_of_arduino_and_platformio(
    exports: Callable[..., Export], tmp_path: Path
) -> None:
    """With every file of the folder compiled, as Arduino does, there is one main: the sketch's."""
    export = exports("chain", "float")
    prefix = export.identity.prefix
    properties = dict(line.split("=", 1) for line in export.files["library.properties"].splitlines())
    asked = ("name", "version", "author", "maintainer", "sentence", "paragraph", "category", "architectures")
    assert all(properties[key] for key in asked)
    assert re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9 _.-]*", properties["name"])
    assert properties["includes"] == f"{prefix}.h"
    manifest = json.loads(export.files["library.json"])
    assert re.fullmatch(r"[a-z0-9](?:[a-z0-9-]*[a-z0-9])?", manifest["name"]) and manifest["headers"]
    assert (
        re.fullmatch(r"\d+\.\d+\.\d+", manifest["version"]) and manifest["version"] == properties["version"]
    )
    assert manifest["build"]["srcFilter"] == f"-<*> +<{prefix}.c>"
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler")
    folder = written(export, tmp_path)
    sketch = f'#include "{prefix}.h"\nint main() {{ return {prefix}_self_test(); }}\n'
    (folder / "sketch.cpp").write_text(sketch, encoding="utf-8")
    for source in (f"{prefix}.c", "main.c"):
        subprocess.run(
            ["gcc", *STRICT.split(), "-Werror", "-DARDUINO=10819", "-c", source], cwd=folder, check=True
        )
    link = ["g++", "-Wall", "-Werror", "sketch.cpp", f"{prefix}.o", "main.o", "-o", "sketch", "-lm"]
    subprocess.run(link, cwd=folder, check=True)
    assert subprocess.run([folder / "sketch"], check=False).returncode == 0


@pytest.mark.parametrize("name", ["paper", "third-nonlinear", "paper-adaptive"])
def test_the_object_has_no_globals_no_allocation_no_recursion(
    name: str, exports: Callable[..., Export], tmp_path: Path
) -> None:
    if any(shutil.which(tool) is None for tool in ("gcc", "nm", "objdump")):
        pytest.skip("no gcc, nm or objdump")
    export = exports(name)
    written(export, tmp_path)
    flags = ["-std=c99", "-O0", "-ffunction-sections", "-fno-builtin", "-fno-stack-protector", "-c"]
    subprocess.run(["gcc", *flags, f"{export.identity.prefix}.c", "-o", "a.o"], cwd=tmp_path, check=True)
    symbols = subprocess.run(["nm", "a.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    outside = {line.split()[-1] for line in symbols.splitlines() if line.split()[-2] == "U"}
    mathematics = {"fabs", "frexp", "ldexp", "sin", "cos", "exp", "sqrt", "tanh", "log", "memcpy", "memset"}
    assert outside <= mathematics | {"_GLOBAL_OFFSET_TABLE_"}, outside
    assert not [line for line in symbols.splitlines() if line.split()[-2] in "bBdDC"]
    listing = subprocess.run(
        ["objdump", "-r", "a.o"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert recursion_faults(listing.stdout) == []


@pytest.mark.parametrize("T", [1e-5, 1e-3, 0.1, 3.0])
def test_the_hold_is_exact(T: float, load: Callable[..., Exported]) -> None:
    loaded = load("third-order")
    loaded.params.sample_time = T
    assert loaded.init(0.0, np.zeros(3)) == 0
    p = loaded.params
    A0 = np.array([[-p.k1, 1, 0], [-p.k2, 0, 1], [-p.k3, 0, 0]])
    Ar = np.array([[-p.ck1, 1], [0, -p.ck2]])
    expected = []
    with mpmath.workdps(60):
        for A in (A0, Ar):
            n = len(A)
            whole = mpmath.zeros(2 * n)
            for i in range(n):
                for j in range(n):
                    whole[i, j] = mpmath.mpf(float(A[i, j])) * T
                whole[i, n + i] = mpmath.mpf(T)
            blocks = mpmath.expm(whole, method="taylor")
            for shift in (0, n):
                expected += [float(blocks[i, j + shift]) for i in range(n) for j in range(n)]
    loaded.params.sample_time = 1e-3
    found, exact = loaded.hold(), np.array(expected)
    # The entries of A0 are of very different size: errors are those of the balanced matrix, entry by entry.
    scale = np.array([1.0, p.k1, p.k1**2])
    for first, n in ((0, 3), (18, 2)):
        for block in range(2):
            part = slice(first + block * n * n, first + (block + 1) * n * n)
            weight = scale[:n, np.newaxis] / scale[np.newaxis, :n]
            error = np.abs(found[part] - exact[part]).reshape(n, n) / weight
            size = np.max(np.abs(exact[part]).reshape(n, n) / weight)
            squarings = max(0.0, np.log2(max(1.0, 2.0 * p.k1 * T)))
            assert np.max(error) <= 2.0 ** (squarings + 1) * 20 * 2.0**-53 * max(size, T if block else 1.0)


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("name", ["paper", "third-order", "braking", "chain", *LEARNERS])
def test_cppcheck_and_its_misra_addon_find_nothing_in_the_controller(
    name: str, precision: str, exports: Callable[..., Export], tmp_path: Path
) -> None:
    if shutil.which("cppcheck") is None:
        pytest.skip("no cppcheck")
    export = exports(name, precision)
    assert _findings(written(export, tmp_path), export.identity.prefix) == []


def test_cppcheck_finds_a_product_in_a_sum_without_brackets(
    exports: Callable[..., Export], tmp_path: Path
) -> None:
    if shutil.which("cppcheck") is None:
        pytest.skip("no cppcheck")
    export = exports("paper")
    written(export, tmp_path)
    bare = export.source.replace("- (p->c2 * z2)", "- p->c2 * z2")
    (tmp_path / f"{export.identity.prefix}.c").write_text(bare, encoding="utf-8")
    assert any("12.1" in line for line in _findings(tmp_path, export.identity.prefix))


def _findings(folder: Path, prefix: str) -> list[str]:
    """Return what cppcheck says of the controller; the example beside it shows which functions are used."""
    form = "--template={file}:{line} {id}"
    flags = ["--addon=misra", "--std=c99", "--enable=warning,performance,portability", "--quiet", form]
    done = subprocess.run(
        ["cppcheck", *flags, f"{prefix}.c", "main.c"], cwd=folder, capture_output=True, text=True, check=False
    )
    return [line for line in done.stderr.splitlines() if line.startswith(prefix)]
