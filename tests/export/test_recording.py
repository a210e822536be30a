"""The self test holds as exported, and sees every literal of an equation and every default that is wrong."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pmjoint_codegen.export.bounds import Bounded
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.recording import outputs, recorded, twin_of
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.export.twin import COMMAND, bounded_arithmetic

CHANGE = 1e-3
LITERAL = re.compile(r"(?<![\w.\[])\d+(?:\.\d*)?(?:e[-+]?\d+)?f?(?![\w.\]])")
PROGRAM = '#include "{0}.h"\nint main(void)\n{{\n    return {0}_self_test();\n}}\n'


def mutants(source: str) -> Iterator[tuple[str, str]]:
    """Give each C file in which one literal of an equation or default is 1e-3 larger, and its line."""
    lines = source.splitlines()
    inside = False
    for place, line in enumerate(lines):
        if re.match(r"(static|void|int).*(_defaults|prepare|advance|law|actuate|_reset)\(", line):
            inside = True
        inside = inside and line != "}"
        statement = line.partition("/*")[0]
        if not inside or "=" not in statement or "matched" in statement:
            continue
        start = statement.index("=")
        for found in LITERAL.finditer(statement, start):
            value = float(found[0].rstrip("f"))
            if value == 0.0 or "." not in found[0]:
                continue
            changed = repr(value * (1.0 + CHANGE)) + ("f" if found[0].endswith("f") else "")
            mutant = line[: found.start()] + changed + line[found.end() :]
            yield "\n".join([*lines[:place], mutant, *lines[place + 1 :]]) + "\n", f"{place + 1}: {mutant}"


def outcome(export: Export, source: str, folder: Path) -> int:
    """Compile a C file with the export's header and run its self test."""
    prefix = export.identity.prefix
    (folder / f"{prefix}.h").write_text(export.files[f"{prefix}.h"], encoding="utf-8")
    (folder / f"{prefix}.c").write_text(source, encoding="utf-8")
    (folder / "test.c").write_text(PROGRAM.format(prefix), encoding="utf-8")
    build = ["cc", "-std=c99", "-O0", "test.c", f"{prefix}.c", "-o", "test", "-lm"]
    subprocess.run(build, cwd=folder, check=True, capture_output=True)
    return subprocess.run(["./test"], cwd=folder, check=False).returncode


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("name", ["paper", "braking", "chain", "joint-exact"])
def test_a_literal_that_is_wrong_by_a_thousandth_is_seen(
    name: str, exports: Callable[..., Export], tmp_path: Path
) -> None:
    export = exports(name)
    assert outcome(export, export.source, tmp_path) == 0
    found = {line: outcome(export, source, tmp_path) for source, line in mutants(export.source)}
    assert len(found) >= len(export.program.parameters) + 3
    assert [line for line, code in found.items() if code == 0] == []


@pytest.mark.parametrize("name", ["paper", "joint-lag", "third-nonlinear", "braking", "chain"])
@pytest.mark.parametrize("matched", [False, True])
def test_a_run_in_doubles_keeps_its_tolerance_and_meets_both_limits(
    name: str, matched: bool, exports: Callable[..., Export]
) -> None:
    program = exports(name).program
    samples = list(recorded(program, DOUBLE, matched=matched))
    twin = twin_of(program, bounded_arithmetic(DOUBLE), DOUBLE, matched=matched)
    for k, sample in enumerate(samples):
        y, y_r = Bounded(sample.y, 0.0), [Bounded(entry, 0.0) for entry in sample.y_r]
        if k == 0:
            twin.reset(y, y_r)
        if sample.command is not None:
            twin.values[COMMAND] = Bounded(sample.command, 0.0)
        measured = None if sample.measured_u is None else Bounded(sample.measured_u, 0.0)
        found = twin.step(y, y_r, measured)
        for symbol, expected, tolerance in zip(
            outputs(program), sample.expected, sample.tolerance, strict=True
        ):
            assert abs(found[symbol].value - expected) <= tolerance, (k, symbol)
    commands = [sample.expected[1] for sample in samples]
    v = [sample.expected[0] for sample in samples]
    if not matched:
        assert min(commands) > min(v) and max(commands) < max(v)
