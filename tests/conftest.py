"""Fixtures of the whole suite: where the project stands, and a kernel cache of the suite's own."""

from __future__ import annotations

import functools
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.kernels import compiled
from pmjoint_codegen.manifest import Manifest

ROOT = Path(__file__).resolve().parent.parent

# A loaded machine is no fault of the code. A change is judged on the same examples each time; at the desk,
# each run tries others.
SLOW = [hypothesis.HealthCheck.too_slow]
hypothesis.settings.register_profile("desk", deadline=None, suppress_health_check=SLOW)
hypothesis.settings.register_profile("ci", deadline=None, suppress_health_check=SLOW, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "desk")


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """Let tests send Ctrl-C: what a shell starts in the background inherits that it is ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def root() -> Path:
    """Return the folder that holds pyproject.toml."""
    return ROOT


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Iterator[Path]:
    """Return the kernel cache of this run: not the user's, one for all workers, so that C compiles once."""
    base = tmp_path_factory.getbasetemp()
    folder = (base if worker_id == "master" else base.parent) / "kernel-cache"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PMJOINT_CACHE", str(folder))
        patch.setenv("MPLBACKEND", "Agg")
        patch.setenv("MPLCONFIGDIR", str(folder / "matplotlib"))
        yield folder


@pytest.fixture
def no_ziglang(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide the compiler that Python's packages bring, as on a machine without it."""
    monkeypatch.setattr("pmjoint_codegen.compile.compiler.packaged", lambda _env: None)


@pytest.fixture(scope="session")
def compiled_paper(root: Path, cache: Path) -> compiled.CompiledEvaluator:
    """Return the paper's kernels as C."""
    folder = root / "generated" / "paper"
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    return compiled.load(folder, Manifest.read(folder), compiler, cache)


@pytest.fixture(scope="session")
def bench(root: Path, cache: Path) -> Callable[[str], ClosedLoop]:
    """Return the loader of ``bench.toml`` with an evaluator: a model with all that a bench has."""
    file = root / "tests" / "bench.toml"
    return functools.cache(lambda evaluator: ClosedLoop.load(file, evaluator))


@pytest.fixture(scope="session", autouse=True)
def patience() -> Iterator[None]:
    """Let no line of progress come between what tests read, however loaded the machine is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PMJOINT_PROGRESS", "0")
        yield


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print the table of mutants and the gates that caught them: counts, or with ``-v`` every mutant."""
    reports = [
        report for kind in terminalreporter.stats.values() for report in kind if hasattr(report, "when")
    ]
    finished = [report for report in reports if report.when == "teardown"]
    tables = [value for report in finished for name, value in report.user_properties if name == "mutants"]
    rows = [row for table in tables for row in table.splitlines()]
    if not rows:
        return
    terminalreporter.section("mutants and the gates that caught them")
    survivors = [row for row in rows if " SURVIVED " in row]
    for row in sorted(rows) if config.get_verbosity() > 0 else survivors:
        terminalreporter.write_line(row)
    for gate, count in sorted(Counter(row.split()[0] for row in rows).items()):
        terminalreporter.write_line(f"{gate:24s} {count} mutants")
    terminalreporter.write_line(f"{len(rows)} mutants, {len(survivors)} survivors; -v lists them")
