"""``pmjoint doctor``: what was found on the machine, and what that means for the user."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pmjoint_codegen import __version__
from pmjoint_codegen.cli.terminal import document, message, result, table
from pmjoint_codegen.errors import installing

if TYPE_CHECKING:
    from pmjoint_codegen.compile.compiler import Compiler

_PROGRAM_PATIENCE_S = 10.0
_PACKAGE_PATIENCE_S = 120.0

_PACKAGES = {
    "numpy": ("simulates", "nothing runs without it"),
    "cffi": ("loads compiled kernels", "without it, use --evaluator interpreted"),
    "click": ("reads the command line", "nothing runs without it"),
    "matplotlib": ("draws figures", "without it, use --no-figures"),
    "rich": ("draws progress bars", "without it there are none"),
    "scipy": ("supplies numerical tools for sweeps", "not needed by a single run"),
    "sympy": ("derives", "without it, only the committed models run, as they are"),
    "casadi": (
        "generates C, and runs kernels where there is no compiler",
        "without it, only the committed models run, compiled",
    ),
    "pint": ("converts units of [joint]", "without it, they must be SI units"),
    "pydantic": ("validates model files", "without it, only the committed models run, as they are"),
}
_OPTIONAL = {  # what it does, and what installs it
    "control": ("`ClosedLoop.to_control`: systems of python-control", "pmjoint-codegen[control]"),
    "xarray": ("`pmjoint sweep`: labels its datasets", "pmjoint-codegen[sweep]"),
    "zarr": ("`pmjoint sweep`: writes its datasets", "pmjoint-codegen[sweep]"),
    "h5netcdf": ("`pmjoint sweep --format netcdf`", "pmjoint-codegen[sweep]"),
    "pyarrow": ("`pmjoint simulate --format parquet`, and that of sweeps", "pmjoint-codegen[logs]"),
    "mcap": ("`pmjoint simulate --format mcap`: runs for Foxglove", "pmjoint-codegen[logs]"),
    "distributed": ("`pmjoint sweep --scheduler`: a Dask cluster", "pmjoint-codegen[sweep]"),
    "ziglang": (
        "compiles kernels where the system has no compiler, and exports for other machines",
        "pmjoint-codegen[compiler]",
    ),
    "heyoka": ("`pmjoint check`: the independent solver", "heyoka"),
}
_PROGRAMS = {
    "gcc": ("compiles kernels; one of two compilers that generated C is tested with", "apt-get install gcc"),
    "clang": (
        "compiles kernels; one of two compilers that generated C is tested with",
        "apt-get install clang",
    ),
    "cppcheck": ("static analysis of generated C", "apt-get install cppcheck"),
    "valgrind": ("memory errors of generated C", "apt-get install valgrind"),
    "pdflatex": ("typesets `pmjoint derive --format latex`", "apt-get install texlive-latex-base"),
}


@dataclass(frozen=True)
class Finding:
    """One thing that was looked for.

    Attributes:
        name: what it is.
        group: ``machine``, ``packages``, ``optional packages`` or ``optional programs``.
        state: ``ok``, ``absent`` or ``differs`` (there, but not as pinned).
        found: version or place; empty where absent.
        meaning: what that means for the user.
    """

    name: str
    group: str
    state: str
    found: str
    meaning: str


_ABOUT = """Show what this machine has (compiler, packages, optional programs) and what that means."""


@click.command(help=_ABOUT)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(as_json: bool) -> None:
    """Run ``pmjoint doctor``: click passes the parsed arguments."""
    findings = list(examine(os.environ))
    if as_json:
        document({"version": __version__, "findings": [asdict(finding) for finding in findings]})
    else:
        result(as_text(findings))


def examine(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Look at the machine.

    Args:
        environment: for ``PATH``, ``CC`` and the cache folder.
    """
    yield _python()
    yield _compiler(environment)
    yield from _cache(environment)
    pins = pinned()
    for name, (purpose, without) in _PACKAGES.items():
        yield _package(name, purpose, without, pins.get(name, ""))
    for name, (purpose, bringer) in _OPTIONAL.items():
        yield _optional(name, purpose, bringer)
    for name, (purpose, remedy) in _PROGRAMS.items():
        yield _program(name, purpose, remedy, environment)


def as_text(findings: list[Finding]) -> str:
    """Format the findings as a table, group by group."""
    lines = [
        f"pmjoint {__version__} on {platform.system()} {platform.machine()}, {os.cpu_count()} processors"
    ]
    for group in dict.fromkeys(finding.group for finding in findings):
        members = [finding for finding in findings if finding.group == group]
        lines += ["", group, table([(item.name, item.state, item.found, item.meaning) for item in members])]
    return "\n".join(lines)


def _python() -> Finding:
    return Finding("python", "machine", "ok", platform.python_version(), sys.executable)


def _compiler(environment: Mapping[str, str]) -> Finding:
    from pmjoint_codegen.compile.compiler import INSTALL, find_compiler, install_line

    compiler = find_compiler(environment, message)
    if compiler is None:
        meaning = f"kernels run interpreted, same results, far slower; to compile them: {install_line()}"
        return Finding("C compiler", "machine", "absent", "", meaning)
    found = _first_line([*compiler.command, "--version"]) or "of unknown version"
    command_line = compiler.shown
    if fault := _compiler_fault(compiler):
        meaning = (
            f"{command_line} compiles nothing ({fault}); choose another with CC=..., or: {INSTALL} libc6-dev"
        )
        return Finding("C compiler", "machine", "differs", found, meaning)
    return Finding(
        "C compiler", "machine", "ok", found, f"{command_line}: compiles each model's kernels on first use"
    )


def _compiler_fault(compiler: Compiler) -> str:
    """Why a compiler cannot build a library, in one line: wrong flags, no headers; empty if it can."""
    from pmjoint_codegen.compile.library import build
    from pmjoint_codegen.errors import BuildError
    from pmjoint_codegen.scratch import scratch

    source = b"#include <math.h>\ndouble root(double a);\ndouble root(double a) { return sqrt(a); }\n"
    # The package's first use builds parts of a C library.
    patience = _PACKAGE_PATIENCE_S if compiler.package else _PROGRAM_PATIENCE_S
    with scratch("pmjoint-doctor") as folder:
        try:
            build({"root.c": source}, compiler, folder, patience=patience)
        except BuildError as error:
            lines = error.output.strip().splitlines()
            return next((line for line in lines if "error" in line), [*lines, error.what][0]).strip()
    return ""


def _cache(environment: Mapping[str, str]) -> Iterator[Finding]:
    from pmjoint_codegen.workspace import cache_dir, cache_place

    wanted, reason = cache_place(environment)
    folder = cache_dir(environment)
    if reason is not None:
        meaning = f"not used: {reason}; {_mend_cache(wanted)}"
        yield Finding("cache asked for", "machine", "differs", str(wanted or "none"), meaning)
    if not os.access(folder, os.W_OK):
        meaning = "not writable: nothing is kept between runs"
        yield Finding("cache", "machine", "absent", str(folder), meaning)
    else:
        meaning = "writable by you alone: keeps compiled kernels and derived models"
        yield Finding("cache", "machine", "ok", str(folder), meaning)


def _mend_cache(wanted: Path | None) -> str:
    """How to make a cache folder trustworthy."""
    if wanted is None:
        return "set PMJOINT_CACHE to a folder of your own"
    return (
        f"set PMJOINT_CACHE to a folder of your own, or take it from others: "
        f"chown {os.getuid()} and chmod go-w, here and on the folders above"
    )


def _package(name: str, purpose: str, without: str, pin: str) -> Finding:
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        remedy = installing(f"{name}{pin}")
        return Finding(name, "packages", "absent", "", f"{purpose}; {without}; {remedy}")
    if pin.startswith("==") and version != pin[2:]:
        return Finding(
            name, "packages", "differs", version, f"{purpose}; pinned {pin[2:]}: generated text may differ"
        )
    return Finding(name, "packages", "ok", version, f"{purpose} (wanted {pin})" if pin else purpose)


def _optional(name: str, purpose: str, bringer: str) -> Finding:
    try:
        return Finding(name, "optional packages", "ok", metadata.version(name), purpose)
    except metadata.PackageNotFoundError:
        return Finding(name, "optional packages", "absent", "", f"{purpose}; {installing(bringer)}")


def _program(name: str, purpose: str, remedy: str, environment: Mapping[str, str]) -> Finding:
    path = shutil.which(name, path=environment.get("PATH"))
    if path is None:
        return Finding(name, "optional programs", "absent", "", f"{purpose}; {remedy}")
    return Finding(name, "optional programs", "ok", _first_line([path, "--version"]) or path, purpose)


def _first_line(command_line: list[str]) -> str:
    """Give the first line that a program prints, or nothing if it cannot be run."""
    try:
        done = subprocess.run(
            command_line,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_PROGRAM_PATIENCE_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    lines = (done.stdout or done.stderr).strip().splitlines()
    return lines[0].strip() if lines else ""


def pinned() -> dict[str, str]:
    """Give the versions that this package requires of others, such as ``==3.8.2`` for casadi."""
    pattern = re.compile(r"\s*([A-Za-z0-9_.-]+)\s*([^;\[]*)")
    matches = (pattern.match(line) for line in _requirements())
    return {match.group(1).lower(): match.group(2).strip() for match in matches if match}


def _requirements() -> list[str]:
    project = Path(__file__).resolve().parents[2] / "pyproject.toml"
    if not project.is_file():
        try:
            return metadata.requires("pmjoint-codegen") or []
        except metadata.PackageNotFoundError:
            return []
    import tomllib

    declared = tomllib.loads(project.read_text(encoding="utf-8")).get("project", {})
    extras = declared.get("optional-dependencies", {})
    return [*declared.get("dependencies", []), *(line for lines in extras.values() for line in lines)]
