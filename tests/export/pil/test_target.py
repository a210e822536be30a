"""The exported controller on emulated processors: what is measured there, and what is found out."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import BuildError, CheckFailed
from pmjoint_codegen.export.elsewhere import library_functions
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.pil.chips import chip_named
from pmjoint_codegen.export.pil.compare import compare
from pmjoint_codegen.export.pil.records import check_counter, other_bits
from pmjoint_codegen.export.pil.target import Bench, deliver, run
from pmjoint_codegen.export.targets.target import Order, Report
from pmjoint_codegen.simulate.samples import record
from pmjoint_codegen.values import ZERO
from tests.export.pil.conftest import Built, samples, tools_of, write

ROOT = Path(__file__).resolve().parents[3]
BAR = 700  # instructions of a step of the paper's controller in float on a Cortex-M4F
Make = Callable[[str, str], Built]
Change = Callable[[Built, str, str, str], Built]


def reported(chip: str, document: dict[str, Any], export: Export, folder: Path, count: int) -> Report:
    """What a run of a shipped model's target reports."""
    tools_of(chip)
    order = Order(
        export.program.derivation,
        export.identity,
        document,
        export.precision,
        os.environ,
        file=ROOT / "models" / f"{export.identity.model}.toml",
    )
    write(folder, deliver(chip_named(chip), order).files)  # type: ignore[arg-type]  # it has text alone
    return run(chip_named(chip), order, folder, count)


@pytest.fixture(scope="module")
def report(
    exports: Callable[..., Export],
    documents: Callable[[str], dict[str, Any]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Report:
    """The report of the paper's controller on a Cortex-M4F."""
    folder = tmp_path_factory.mktemp("cortex")
    return reported("cortex-m4f", documents("paper"), exports("paper"), folder, 10_000)


@pytest.fixture(scope="module")
def adaptive(
    exports: Callable[..., Export],
    documents: Callable[[str], dict[str, Any]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Report:
    """The report of the paper's controller with estimates on a Cortex-M4F."""
    folder = tmp_path_factory.mktemp("adaptive")
    name = "paper-adaptive"
    return reported("cortex-m4f", documents(name), exports(name), folder, 10_000)


@pytest.fixture
def cortex(report: Report) -> dict[str, Any]:
    """The same as data."""
    return dict(report.record)


def test_ten_thousand_recorded_samples_give_the_bits_of_this_machine(cortex: dict[str, Any]) -> None:
    assert cortex["samples"] == 10_000 and cortex["library_functions"] == []
    for precision in ("double", "float"):
        found = cortex[precision]
        assert found["values"] == 160_000 and found["other_bits"] == 0
        assert found["step_over_bound"] <= 1.0
    assert 0.0 < cortex["float"]["v_deviation"] < 1e-4


def test_the_closed_loop_with_the_processor_inside_follows_the_simulated_one(cortex: dict[str, Any]) -> None:
    for precision in ("double", "float"):
        assert cortex[precision]["loop_other_bits"] == 0 and cortex[precision]["loop_over_bound"] <= 1.0
    assert cortex["double"]["loop_deviation"] < 1e-12
    assert cortex["float"]["loop_deviation"] > 1e-9  # a float's y is not the double's: v did act


def test_a_step_in_float_takes_few_instructions(cortex: dict[str, Any]) -> None:
    assert 100 < cortex["float"]["step_instructions_most"] <= BAR
    assert cortex["double"]["step_instructions"] > 10 * cortex["float"]["step_instructions"]


def test_estimates_cost_no_second_evaluation_of_the_law(adaptive: Report, cortex: dict[str, Any]) -> None:
    found = dict(adaptive.record)
    assert found["library_functions"] == ["tanh"]
    for precision in ("double", "float"):
        assert found[precision]["step_over_bound"] <= 1.0 and found[precision]["loop_over_bound"] <= 1.0
    assert found["float"]["step_instructions_most"] <= BAR
    assert found["float"]["step_instructions"] < 2.0 * cortex["float"]["step_instructions"]
    assert found["double"]["loop_deviation"] < 1e-11


def test_the_page_shows_what_the_command_prints(report: Report, adaptive: Report) -> None:
    compiler = chip_named("cortex-m4f").compiler
    done = subprocess.run([compiler, "-dumpversion"], capture_output=True, text=True, check=True)
    if not done.stdout.startswith("12.2."):
        pytest.skip("the page has the numbers of another compiler")
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    shown, of_estimates = re.findall(r"^```text\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    assert shown.splitlines() == list(report.lines[2:])
    assert set(of_estimates.splitlines()) <= set(adaptive.lines[2:])


def test_a_risc_v_runs_the_same_program(
    exports: Callable[..., Export], documents: Callable[[str], dict[str, Any]], tmp_path: Path
) -> None:
    found = reported("riscv32", documents("paper"), exports("paper"), tmp_path, 500).record
    for precision in ("double", "float"):
        assert found[precision]["other_bits"] == found[precision]["loop_other_bits"] == 0
        assert found[precision]["loop_samples"] == 500
    assert found["double"]["loop_deviation"] < 1e-12


@pytest.mark.parametrize("model", ["braking", "dc-pendulum"])
@pytest.mark.parametrize("precision", ["double", "float"])
def test_other_controllers_agree(model: str, precision: str, built: Make) -> None:
    """Braking has a law of its own; the pendulum calls sin and cos, which newlib computes in its own way."""
    folder = built(model, "cortex-m4f")
    export = folder.exports[precision]
    given = samples(export, 1000)
    target, host = folder.emulated(precision, given), folder.native(precision, given)
    limit = np.max(np.abs(target.column("command")))
    assert np.max(np.abs(target.column("v"))) > limit
    found = compare(export, given, target, host, model)
    called = library_functions(export.program)
    assert called == (("cos", "sin") if model == "dc-pendulum" else ())
    assert found.ratio <= 1.0 and (found.ratio > 0.0 if called else found.other_bits == 0)


def test_a_wrong_literal_on_the_processor_is_found(built: Make, changed: Change) -> None:
    folder = built("paper", "cortex-m4f")
    wrong = changed(folder, "double/pmjoint_paper.c", "params->c1 = 15.0;", "params->c1 = 15.015;")
    with pytest.raises(CheckFailed, match="self_test: row 1 differs"):
        wrong.emulated("double", samples(folder.exports["double"], 5))


def test_fused_products_and_sums_are_found(built: Make, changed: Change) -> None:
    """They hold the self test, as its tolerance must allow, but they have other bits."""
    folder = built("paper", "cortex-m4f")
    fused = changed(
        folder, "Makefile", "CFLAGS = -O2 -std=c99 -ffp-contract=off", "CFLAGS = -O2 -ffp-contract=fast"
    )
    export = folder.exports["float"]
    given = samples(export, 50)
    target = fused.emulated("float", given)
    with pytest.raises(CheckFailed, match="values have other bits: "):
        compare(export, given, target, folder.native("float", given), "fused")


def test_a_step_beyond_its_bound_is_found(built: Make) -> None:
    """Where bits may differ, the bound judges each step; this one also spoils the state of the next."""
    folder = built("dc-pendulum", "cortex-m4f")
    export = folder.exports["double"]
    given = samples(export, 50)
    target, host = folder.emulated("double", given), folder.native("double", given)
    records = target.records.copy()
    records["values"][20, target.layout.columns.values.index("v")] *= 1.0 + 1e-12
    with pytest.raises(CheckFailed, match=r"\w+ at sample 2[01] is off by .* times its derived bound"):
        compare(export, given, replace(target, records=records), host, "off")


def test_flags_of_a_step_are_found(built: Make) -> None:
    folder = built("paper", "cortex-m4f")
    given = samples(folder.exports["double"], 5)
    given[3, 0] = np.nan
    with pytest.raises(CheckFailed, match="flags 1 at sample 3"):
        folder.emulated("double", given)


def test_a_loop_that_leaves_the_simulated_one_is_found(built: Make) -> None:
    folder = built("paper", "cortex-m4f")
    evaluator = ClosedLoop.load("paper").evaluator
    recorded = record(evaluator, ZERO, 99)
    assert not isinstance(recorded, str)
    other = replace(recorded, reading=recorded.reading + 1e-6)
    bench = Bench(folder.tools, folder.folder, evaluator, other, ZERO, 100)
    with pytest.raises(CheckFailed, match="y leaves the simulated run by 1e-06"):
        bench.measure(folder.exports["double"])


def test_instructions_are_those_of_a_trace(built: Make, tmp_path: Path) -> None:
    """QEMU's log of every instruction, against the counter; the counter sees the call too."""
    folder = built("paper", "cortex-m4f")
    image = folder.folder / "float" / "pil.elf"
    listing = subprocess.run(
        [f"{folder.chip.prefix}nm", "-S", str(image)], capture_output=True, text=True, check=True
    ).stdout
    (start, size) = re.findall(r"^(\w+) (\w+) T \w+_step$", listing, re.MULTILINE)[0]
    given = samples(folder.exports["float"], 3)
    (tmp_path / "input.bin").write_bytes(folder.layout("float").given(given))
    command = [*folder.tools.emulator, "-singlestep", "-d", "nochain,exec", "-D", "log"]
    command += ["-dfilter", f"0x{start}+0x{size}", "-kernel", str(image)]
    subprocess.run(command, cwd=tmp_path, timeout=60, check=True, stdin=subprocess.DEVNULL)
    places = re.findall(r"^Trace .*?/(\w+)/", (tmp_path / "log").read_text(), re.MULTILINE)
    begins = [i for i, place in enumerate(places) if int(place, 16) == int(start, 16)]
    traced = np.diff([*begins, len(places)])[-3:]
    counted = folder.emulated("float", given).instructions(folder.chip)
    call = counted - traced
    assert np.all((call >= 4) & (call <= 8)), (counted, traced)


def test_the_stack_is_that_of_the_compiler(built: Make) -> None:
    """A step in float calls nothing, so the compiler states its whole stack."""
    folder = built("paper", "cortex-m4f")
    stated = (folder.folder / "float" / "pmjoint_paper.su").read_text(encoding="utf-8")
    (size,) = re.findall(r"_step\t(\d+)\tstatic", stated)
    assert folder.emulated("float", samples(folder.exports["float"], 5)).step_stack == int(size)


def test_a_clock_that_does_not_count_instructions_is_found(built: Make) -> None:
    folder = built("paper", "cortex-m4f")
    emulator = tuple("auto" if item == "shift=7" else item for item in folder.tools.emulator)
    emulator = tuple("shift=6" if item == "auto" else item for item in emulator)
    other = replace(folder, tools=replace(folder.tools, emulator=emulator))
    answer = other.emulated("float", samples(folder.exports["float"], 5))
    with pytest.raises(CheckFailed, match="does not count instructions"):
        check_counter(answer.header, folder.chip)


def test_matching_answers_have_no_other_bits_and_a_changed_one_has(built: Make) -> None:
    folder = built("paper", "cortex-m4f")
    answer = folder.native("float", samples(folder.exports["float"], 5))
    records = answer.records.copy()
    records["values"][2, 1] = np.nextafter(records["values"][2, 1], np.float32(9.0))
    found = other_bits(answer, replace(answer, records=records))
    assert np.argwhere(found).tolist() == [[2, 1]]


def test_a_build_that_fails_names_the_packages(built: Make, changed: Change) -> None:
    folder = built("paper", "cortex-m4f")
    with pytest.raises(BuildError, match="gcc-arm-none-eabi libnewlib-arm-none-eabi"):
        changed(folder, "start.c", "begin();", "begin() + nothing;")


def test_a_folder_is_the_same_each_time(exports: Callable[..., Export]) -> None:
    export = exports("paper")
    order = Order(export.program.derivation, export.identity, {}, export.precision, {}, Path("paper.toml"))
    first, second = (deliver(chip_named("cortex-m4f"), order).files for _ in range(2))
    assert first == second
    left = [name for name, text in first.items() if re.search(r"@\w+@", str(text))]
    assert left == []
