"""Gates on sound models, on models of other orders, and on machines that lack something."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import textwrap
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.check import harness, trajectory
from pmjoint_codegen.check.gates import (
    certificate,
    compilers,
    derivatives,
    golden,
    proof,
    symbolic,
)
from pmjoint_codegen.check.inputs.points import batches
from pmjoint_codegen.check.oracles.certificate import certify
from pmjoint_codegen.check.result import GateResult, Verdict, passed
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.check.table import GATES, Gate, run_gate, run_gates, select
from pmjoint_codegen.emit.regenerate import regenerate
from pmjoint_codegen.errors import UsageError

OTHER = """\
    schema = 1
    name   = "{name}"
    title  = "Nonlinear test plant"
    source = "made for this test"
    [parameters]
    d1    = {{ value = 0.2,  unit = "1/s^2", about = "stiffness" }}
    b0    = {{ value = 2.0,  unit = "rad/(s^2 V)", about = "input gain" }}
    kappa = {{ value = 0.1,  unit = "1/rad^2", about = "quadratic gain" }}
    u_max = {{ value = 10.0, unit = "V", about = "limit" }}
    [plant]
    order = {order}
    phi   = {phi}
    Phi   = {Phi}
    theta = ["d1"]
    b     = {b}
    sigma = "1 + kappa*y**2"
    disturbance = {disturbance}
    [actuator]
    limit = "u_max"
    [design]
    c = {ones}
    e = {tenths}
    ck = {ones}
    k = {k}
    [simulation]
    reference   = "sin(t)"
    x0          = {x0}
    horizon     = 1.0
    output_step = 0.1
    sample_time = 0.01
"""


def other_model(folder: Path, order: int, rho: int) -> Path:
    """A model with every feature: phi with functions, sigma, zeros; generated beside it."""
    lists = {
        "phi": ["-y**3/5", "tanh(y) + exp(-y/9)", "sqrt(1 + y**2)"][:order],
        "Phi": [*[["0"]] * (order - 1), ["y"]],
        "b": ["b0", "3", "2"][: order - rho + 1],
        "disturbance": ["0.01*sin(t)"] * order,
        "ones": [3.0] * rho,
        "tenths": [0.1] * rho,
        "k": [[4.0], [4.0, 4.0], [6.0, 12.0, 8.0]][order - 1],
        "x0": [0.2, *[0.0] * (order - 1)],
    }
    words = {key: json.dumps(value) for key, value in lists.items()}
    text = textwrap.dedent(OTHER).format(name=f"n{order}rho{rho}", order=order, **words)
    (folder / "models").mkdir(exist_ok=True)
    file = folder / "models" / f"n{order}rho{rho}.toml"
    file.write_text(text)
    regenerate([str(file)])
    return file


def test_a_value_that_the_code_loses_is_a_difference(paper: Subject) -> None:
    assert paper.compiled is not None
    function = paper.manifest.function("estimate")
    prepared = symbolic.prepare(paper, function, 2)
    results = [array.copy() for array in paper.compiled.call("estimate", *prepared.arguments)]
    lost = dataclasses.replace(
        prepared, bounds=tuple(np.full_like(bound, np.inf) for bound in prepared.bounds)
    )
    judgement = symbolic.judge(lost, results)
    assert judgement.unbounded == judgement.values == results[0].size
    assert symbolic.conclude([judgement]).verdict is Verdict.FAILED
    results[0][3, 1] = np.nan
    found = symbolic.conclude([symbolic.judge(prepared, results)])
    assert found.difference is not None and found.difference.found == "nan"


@pytest.mark.parametrize("name", ["law", "signals", "taylor"])
def test_points_stay_within_the_range_of_the_design(paper: Subject, name: str) -> None:
    """Where a model states one; elsewhere angles of all sizes are drawn."""
    function = paper.manifest.function(name)
    place = next(i for i, (label, _) in enumerate(function.inputs) if label in ("y", "X"))
    for y_range, within in ((None, False), ((-0.5, 0.7), True)):
        found = batches(paper.interpreted, function, 8, 1, extreme=False, y_range=y_range)
        y = np.concatenate([batch.arguments[place][:, 0] for batch in found])
        assert bool(np.all((y >= -0.5) & (y <= 0.7))) is within


def test_only_where_products_of_coefficients_overflow_a_bound_may_be_missing(paper: Subject) -> None:
    """Coefficients beyond the root of the largest double; below it, every result has a bound."""
    function = next(item for item in paper.manifest.functions if item.name == "taylor")
    prepared = symbolic.prepare(paper, function, 1)
    results = [np.full_like(bound, np.nan) for bound in prepared.bounds]
    unbounded = tuple(np.full_like(bound, np.inf) for bound in prepared.bounds)
    sizes = {1e150: sum(bound.size for bound in prepared.bounds), 1e160: 0}
    for size, counted in sizes.items():
        exact = tuple([[size for _ in row] for row in table] for table in prepared.exact)
        steep = dataclasses.replace(prepared, bounds=unbounded, exact=exact)
        assert symbolic.judge(steep, results).unbounded == counted


def silent(_line: str) -> None:
    """Take no notice."""


@pytest.mark.parametrize(("order", "rho"), [(1, 1), (2, 1), (3, 2)])
def test_other_orders_pass_what_does_not_need_golden_files(tmp_path: Path, order: int, rho: int) -> None:
    subject = load_subject(other_model(tmp_path, order, rho), os.environ, silent)
    names = ["current", "proof", "interpreter", "lanes", "symbolic", "derivatives", "trajectory"]
    results = {result.name: result for result in run_gates(subject, select(names))}
    assert results.pop("trajectory.golden").verdict is Verdict.NOT_RUN
    assert {name: result.detail for name, result in results.items() if result.verdict is Verdict.FAILED} == {}
    assert results["symbolic"].figure is not None and 0.01 < results["symbolic"].figure <= 1


@pytest.mark.parametrize(("order", "rho"), [(1, 1), (2, 2)])
def test_a_disturbance_of_the_output_stays_within_the_bounds_of_its_certificate(
    tmp_path: Path, order: int, rho: int
) -> None:
    """Fast filters and strong e make epsilon_2 and |P| small: nearly all that counts is then D_1."""
    file = other_model(tmp_path, order, rho)
    quick = {1: "[40.0]", 2: "[40.0, 400.0]"}[order]
    lines = [f"k = {quick}" if line.startswith("k = ") else line for line in file.read_text().splitlines()]
    text = (
        "\n".join(lines)
        .replace("0.01*sin(t)", "0.05*tanh(50*sin(t))")
        .replace(f"e = {[0.1] * rho}", f"e = {[20.0] * rho}")
    )
    file.write_text(text.replace("horizon     = 1.0", "horizon     = 9.0"))
    regenerate([str(file)])
    subject = load_subject(file, os.environ, silent)
    found = run_gate(subject, select(["trajectory.certificate"])[0])
    assert found.verdict is Verdict.PASSED, found.detail
    run = trajectory.default_run(subject.compiled or subject.interpreted)
    largest = float(np.max(np.linalg.norm(certificate.disturbances(subject.interpreted, run), axis=1)))
    sharp = certify(subject.derivation, proof.design_values(subject.derivation), largest)
    late = run.t > 6
    z = np.column_stack([run[f"z{i + 1}"][late] for i in range(rho)])
    assert sharp.z_sharp is not None and sharp.z1_sharp is not None
    assert np.max(np.linalg.norm(z, axis=1)) <= sharp.z_sharp + trajectory.ACCURACY
    assert np.max(np.abs(z[:, 0])) <= sharp.z1_sharp + trajectory.ACCURACY  # where n = 1, it is attained
    assert sharp.eta in sharp.lines()[-1] and sharp.eta.endswith("D_1")


@pytest.mark.parametrize("bound", ["", "disturbance_bound = 0.02"])
def test_a_disturbance_with_a_kink_is_judged_as_any_other(tmp_path: Path, bound: str) -> None:
    file = other_model(tmp_path, 2, 2)
    text = file.read_text().replace('"0.01*sin(t)"', '"0.03*sign(x2) + 0.01*abs(sin(t))"')
    text = text.replace("[actuator]", f"{bound}\n[actuator]").replace(
        "horizon     = 1.0", "horizon     = 0.995"
    )
    file.write_text(text)
    regenerate([str(file)])
    subject = load_subject(file, os.environ, silent)
    golden.write(subject)
    results = {result.name: result for result in run_gates(subject, select(["lanes", "trajectory"]))}
    assert results["lanes"].verdict is Verdict.PASSED, results["lanes"]
    assert results["trajectory.golden"].figure == 0
    assert results["trajectory.invariants"].verdict is Verdict.PASSED, results["trajectory.invariants"]
    assert len(results["trajectory.invariants"].findings) == 3  # of z and u_max nothing: phi is not linear
    assert results["trajectory.independent"].verdict is Verdict.PASSED, results["trajectory.independent"]
    if bound:
        assert "exceeds" in results["trajectory.certificate"].detail
    else:
        assert results["trajectory.certificate"].verdict is Verdict.PASSED


def test_every_gate_passes_on_the_papers_model_or_says_which_tool_is_missing(paper: Subject) -> None:
    results = list(run_gates(paper))
    assert [result.name for result in results] == [gate.name for gate in GATES]
    for result in results:
        assert result.verdict is Verdict.PASSED or result.detail.startswith("no "), result
        assert result.seconds < 30


def test_every_shipped_model_has_its_golden_trajectory_and_no_other_lies_there() -> None:
    """A missing one is `not run`, which is no failure: a user's model has none."""
    root = Path(__file__).resolve().parents[2]
    models = sorted(file.stem for file in (root / "models").glob("*.toml"))
    wanted = sorted(name for model in models for name in (f"{model}.csv", f"{model}.switches.csv"))
    assert sorted(file.name for file in (root / "golden").iterdir()) == wanted


def test_names_stand_for_the_gates_they_begin() -> None:
    assert [gate.name for gate in select(["trajectory.golden", "proof"])] == ["proof", "trajectory.golden"]
    assert len(select(["compilers"])) == 6 and select([]) == GATES
    for asked, meant in {
        "prof": "proof",
        "trajectry": "trajectory",
        "golden": "trajectory.golden",
        "compilers.gc": "compilers.gcc",
    }.items():
        with pytest.raises(UsageError, match=rf"no gate is called '{asked}'; did you mean {meant}\? gates: "):
            select([asked])
    with pytest.raises(UsageError, match="no gate is called 'xyz'; gates: current, "):
        select(["xyz"])


def bare(subject: Subject, tmp_path: Path, *tools: str) -> Subject:
    """The same model on a machine that has these tools only."""
    for tool in tools:
        (tmp_path / tool).symlink_to(shutil.which(tool) or "/nonexistent")
    environment = {"PATH": str(tmp_path), "PMJOINT_CACHE": os.environ["PMJOINT_CACHE"]}
    return dataclasses.replace(subject, environment=environment)


@pytest.mark.usefixtures("no_ziglang")
def test_a_machine_without_tools_runs_few_gates_and_passes_none_of_the_others(
    paper: Subject, tmp_path: Path
) -> None:
    results = {result.name: result for result in run_gates(bare(paper, tmp_path))}
    reasons = {name: result.detail for name, result in results.items() if result.verdict is Verdict.NOT_RUN}
    assert reasons["compilers.gcc"] == "no gcc" and reasons["compilers.clang"] == "no clang"
    assert (
        reasons["compilers.sanitizers"] == "no gcc or clang"
        and reasons["compilers.cppcheck"] == "no cppcheck"
    )
    assert {"interpreter", "symbolic", "derivatives", "compilers.objects", "compilers.valgrind"} <= set(
        reasons
    )
    assert all(results[name].verdict is Verdict.PASSED for name in ("current", "proof", "trajectory.golden"))


def test_nm_and_valgrind_are_missed_by_name(paper: Subject, tmp_path: Path) -> None:
    lean = bare(paper, tmp_path, "gcc")
    assert compilers.check_objects(lean).detail == "no nm"
    assert compilers.check_valgrind(lean).detail == "no valgrind"


@pytest.mark.usefixtures("no_ziglang")
def test_valgrind_without_a_compiler(paper: Subject, tmp_path: Path) -> None:
    if shutil.which("valgrind") is None:
        pytest.skip("no valgrind")
    assert compilers.check_valgrind(bare(paper, tmp_path, "valgrind")).detail == "no C compiler"


def test_without_heyoka_the_independent_run_says_so(paper: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "heyoka", None)
    (gate,) = select(["trajectory.independent"])
    detail = run_gate(paper, gate).detail
    assert detail.startswith("no heyoka; ") and detail.endswith("-m pip install 'heyoka'")


def test_a_folder_that_cannot_be_trusted_stops_what_looks_into_it(paper: Subject, tmp_path: Path) -> None:
    shutil.copytree(paper.folder, folder := tmp_path / "paper")
    (folder / "model.json").write_text("{}")
    results = list(run_gates(dataclasses.replace(paper, folder=folder)))
    assert [result.verdict for result in results[:2]] == [Verdict.FAILED, Verdict.PASSED]
    assert {result.verdict for result in results[2:]} == {Verdict.NOT_RUN}
    assert all("model.json" in result.detail for result in results[2:])


def test_an_error_of_the_models_fails_its_gate(paper: Subject) -> None:
    def refuse(_subject: Subject) -> GateResult:
        raise UsageError("is wrong", where="here")

    result = run_gate(paper, Gate("g", refuse))
    assert (result.name, result.detail) == ("g", "here: is wrong")


@pytest.mark.parametrize(
    "error", [ValueError("attempt to get argmax of an empty sequence"), ZeroDivisionError()]
)
def test_a_gate_that_trips_over_what_the_code_gives_fails_and_the_next_one_runs(
    paper: Subject, error: Exception
) -> None:
    def trip(_subject: Subject) -> GateResult:
        raise error

    gates = [Gate("first", trip), Gate("second", lambda _subject: passed("fine"))]
    first, second = run_gates(paper, gates)
    assert first.verdict is Verdict.FAILED and second.verdict is Verdict.PASSED
    assert first.detail == f"nothing sound to judge: {type(error).__name__} {error}".strip()


def test_a_manifest_with_other_names_is_not_compared(paper: Subject, tmp_path: Path) -> None:
    shutil.copytree(paper.folder, folder := tmp_path / "paper")
    manifest = dataclasses.replace(paper.manifest, partials=(*paper.manifest.partials[:-1], "dalpha1_dx9"))
    (folder / "model.json").write_text(manifest.to_json())
    subject = dataclasses.replace(paper, folder=folder)
    assert "partial derivatives" in symbolic.check(subject).detail
    assert "dalpha1_dx9" in derivatives.check(subject).detail


def test_damaged_golden_files_fail(paper: Subject, tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "golden").mkdir()
    shutil.copy(paper.file, tmp_path / "models")
    subject = dataclasses.replace(paper, file=tmp_path / "models" / "paper.toml")
    assert golden.check(subject).verdict is Verdict.NOT_RUN
    (tmp_path / "golden" / "paper.csv").write_text("t,x1\n0,zero\n")
    (tmp_path / "golden" / "paper.switches.csv").write_text("t,mode\n")
    damaged = golden.check(subject).detail
    assert "is damaged" in damaged and damaged.endswith("pmjoint check paper --update-golden writes it anew")
    rows, switches = golden.write(subject)
    assert golden.check(subject).figure == 0

    late = switches.read_text().splitlines()
    late[1] = f"0.25,{late[1].partition(',')[2]}"
    switches.write_text("\n".join(late) + "\n")
    found = golden.check(subject)
    assert found.detail.startswith("switch 1 differs by 0.195 s: largest difference")
    assert "--update-golden" in found.findings[0]
    golden.write(subject)
    header, first, *others = rows.read_text().splitlines()
    moved = ["0.0", "-6.36", *first.split(",")[2:]]
    rows.write_text("\n".join([header, ",".join(moved), *others]) + "\n")
    assert golden.check(subject).detail.startswith("x1 differs by 1.24 of its scale: largest")


def test_the_harness_counts_missing_results_as_different() -> None:
    one, nan = np.array([1.0, np.nan]).tobytes(), np.array([1.0, -np.nan]).tobytes()
    assert harness.differing(one, nan) == 0
    assert harness.differing(one, one[:8]) == 1
    assert harness.differing(one, b"") == 2


def test_a_tool_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compilers, "TIME_LIMIT", 0.1)
    outcome = compilers.run(["sleep", "5"], tmp_path)
    assert outcome.code != 0 and "took more than" in outcome.first_line


def test_an_outcome_without_words_is_its_exit_code() -> None:
    assert compilers.Outcome(3, b"", "").first_line == "exit code 3"
