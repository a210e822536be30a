"""The gate of the exported C: it passes for models of every kind, and sees any statement that is wrong."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import pytest

from pmjoint_codegen.check.gates import exported
from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.check.result import GateResult, Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.emit.regenerate import regenerate
from pmjoint_codegen.export.package import Export, export_c
from pmjoint_codegen.export.source import Identity

SAMPLES = 400
FUNCTIONS = ("prepare", "advance", "law", "actuate")
NEUTRAL = ("compensator", "input_scale")  # a factor 1 of the paper's model: dividing by it changes nothing
Tally = Callable[[str, str, GateResult], None]

BRAKING = '[design]\nsaturation = "braking"\nbraking = 0.5\nstart = "matched"'
CHAIN = (
    '[actuator]\nlower = -8.0\nupper = "u_max"\nrate = 2000.0\ndead_zone = 0.3\nlag = 0.01\ndelay = 0.002\n'
    "[sensor]\nresolution = 0.001\nnoise = 0.0005\nseed = 3\nfilter = 300.0"
)
STEPS = "reference = { steps = [[0, 0.0], [0.05, 0.4]], filter = 30 }\njitter = 0.0002"


INVERSE = 'form    = "inverse"\ninverse = { gain = 0.5, leakage = 0.01 }\nunknown = ['
LOAD = [
    ('unknown = ["b0", "d1"]', 'unknown = ["b0", "d1", "w"]\nload = true'),
    ("d1 = [-3.0, 3.0] }", "d1 = [-3.0, 3.0], w = [-5.0, 5.0] }"),
    ("leakage = 0.0", "leakage = 0.01"),
    ("compensator = true", 'start = "matched"\ncompensator = true'),
]
SQUARES = [("gain    = { b0 = 1.0, d1 = 1.0 }\nleakage = 0.0", 'estimator = "least_squares"')]
FIRST = [
    ("order = 2", "order = 1"),
    ('["0", "0"]\nPhi   = [["0"], ["y"]]', '["0"]\nPhi   = [["y"]]'),
    ('["0", "0.1*sin(x2)*cos(t)"]', '["0"]'),
    ("disturbance_bound = 0.1", "disturbance_bound = 0.0"),
    ("[15, 15]", "[5]"),
    ("[0.1, 0.1]", "[0.1]"),
    ("[1, 1]", "[2]"),
    ("[6, 8]", "[4]"),
    ("[1.5, 0.0]", "[1.5]"),
    ('"1/s^2"', '"1/s"'),
    ('"rad/(s^2 V)"', '"rad/(s V)"'),
]


def variant(root: Path, folder: Path, *changes: tuple[str, str], model: str = "paper") -> Subject:
    """A model with some text replaced, generated in a folder of its own."""
    text = (root / "models" / f"{model}.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "models").mkdir()
    file = folder / "models" / f"{model}.toml"
    file.write_text(text, encoding="utf-8")
    regenerate([str(file)])
    return load_subject(file, os.environ, lambda _line: None)


@pytest.mark.parametrize(
    "changes",
    [
        [("[design]", BRAKING), ("compensator = true", "")],
        [('[actuator]\nlimit = "u_max"', CHAIN)],
        [
            ('reference   = "sin(t)"', STEPS),
            ("sample_time = 0.001", "sample_time = 0.001\n[sensor]\nseed = 1"),
        ],
        [("compensator = true", "compensator = false")],
    ],
    ids=["braking", "chain", "steps and jitter", "clip"],
)
def test_models_of_every_kind_pass(changes: list[tuple[str, str]], root: Path, tmp_path: Path) -> None:
    result = exported.check(variant(root, tmp_path, *changes))
    assert result.verdict is Verdict.PASSED, result
    assert result.figure is not None and 0.0 < result.figure <= 1.0


@pytest.mark.parametrize(
    "changes",
    [[("unknown = [", INVERSE)], LOAD, SQUARES, FIRST, [*FIRST, ("unknown = [", INVERSE)]],
    ids=["inverse", "load and matched", "least squares", "first order", "inverse of first order"],
)
def test_controllers_with_estimates_pass(changes: list[tuple[str, str]], root: Path, tmp_path: Path) -> None:
    subject = variant(root, tmp_path, *changes, model="paper-adaptive")
    result = exported.check(subject)
    assert result.verdict is Verdict.PASSED, result
    assert result.figure is not None and 0.0 < result.figure <= 1.0


def test_the_papers_model_passes(paper: Subject) -> None:
    result = exported.check(paper)
    assert result.verdict is Verdict.PASSED, result


@pytest.fixture(scope="module")
def export(paper: Subject) -> Export:
    return export_c(paper.derivation, Identity("paper", "", ""))


def mutants(source: str) -> Iterator[tuple[str, str]]:
    """Give each C file with one change in a statement of an equation, and what it is."""
    lines, inside = source.splitlines(), False
    for place, line in enumerate(lines):
        if found := re.match(r"static \w+ (\w+)\(", line):
            inside = found[1] in FUNCTIONS
        inside = inside and line != "}"
        code = line.partition("/*")[0]
        if not inside or line.startswith("static") or any(word in code for word in NEUTRAL):
            continue
        for old, new in (
            (" * ", " / "),
            (" - ", " + "),
            (" + ", " - "),
            ("= -", "= "),
            ("[0][1]", "[0][0]"),
            ("p->k1", "p->k2"),
            ("s->xi1", "s->xi2"),
            ("s->lambda1", "s->lambda2"),
            ("between(v, ", "between(1.0001 * v, "),
        ):
            # The other entry of a matrix that is set: the entry at its place is then set twice.
            if old in code and not (old == "[0][1]" and "A" in code.partition("=")[0]):
                mutant = line.replace(old, new, 1)
                yield "\n".join([*lines[:place], mutant, *lines[place + 1 :]]) + "\n", mutant.strip()


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_every_mutant_of_the_exported_c_is_caught(
    paper: Subject, export: Export, tmp_path: Path, tally: Tally
) -> None:
    assert paper.compiled is not None
    # Without its own self test, so that the comparison with the run is what sees them.
    source = export.source.replace("first = (start * ROWS) + k + 1;", "first = 0;")
    assert source != export.source
    (tmp_path / "pmjoint_paper.h").write_text(export.files["pmjoint_paper.h"], encoding="utf-8")
    count = 0
    for count, (mutant, what) in enumerate(islice(mutants(source), 0, None, 2), start=1):  # the half: time
        (tmp_path / "pmjoint_paper.c").write_text(mutant, encoding="utf-8")
        library = tmp_path / f"{count}.so"
        build = ["cc", "-std=c99", "-O0", "-ffp-contract=off", "-fPIC", "-shared", "pmjoint_paper.c", "-o"]
        subprocess.run([*build, str(library), "-lm"], cwd=tmp_path, check=True, capture_output=True)
        loaded = Exported.open(export, library)
        tally("export", what, exported.judge(loaded, paper.compiled, paper.tapes, SAMPLES))
    assert count >= 30


LEARNT = (
    ("c->b0_logit_next_pull_b0 * s->pull_b0", "c->b0_logit_next_pull_b0 * 0.0"),
    ("b0_turn = tanh(s->b0_logit", "b0_turn = tanh(-s->b0_logit"),
    ("d1_turn = tanh(s->d1_logit / 2.0)", "d1_turn = tanh(s->d1_logit)"),
    ("c->d1_logit_next_pull_d1 * s->pull_d1", "c->d1_logit_next_pull_d1 * s->pull_b0"),
    ("s->pull_b0 = pull_b0;", "s->pull_b0 = tau_b0;"),
    ("s->pull_d1 = pull_d1;", "s->pull_d1 = 1.001 * pull_d1;"),
    ("if (s->learns != 0)", "if (s->learns == 0)"),
    ("- (c->b0_hat_b0_turn * b0_turn)", "+ (c->b0_hat_b0_turn * b0_turn)"),
    ("c->b0_hat_b0_turn_ * b0_turn", "1.001 * c->b0_hat_b0_turn_ * b0_turn"),
    ("s->b0_logit = b0_logit_next;", "s->b0_logit = s->b0_logit;"),
    ("s->b0_hat = b0_hat;", "s->b0_hat = p->b0_guess;"),
    ("+ (s->b0_hat * ((c->Fr[1][2]", "+ (p->b0_guess * ((c->Fr[1][2]"),
    ("c->Fr[1][2] * s->chi2", "c->Fr[2][2] * s->chi2"),
    ("inverse_b0_hat = 1.0 / b0_hat", "inverse_b0_hat = 1.0 / p->b0_guess"),
    ("zeta2 = z1 - (", "zeta2 = z1 + ("),
    ("tau_b0 = omega_b0", "tau_b0 = omega_d1"),
    ("(p->b0_high - b0_hat) * (b0_hat - p->b0_low)", "(p->b0_high - b0_hat)"),
    ("+ (Gamma_b0 * dalpha1_db0_hat", "- (Gamma_b0 * dalpha1_db0_hat"),
    ("+ (Gamma_d1 * dalpha1_dd1_hat", "+ 0.0 * (Gamma_d1 * dalpha1_dd1_hat"),
    ("+ (dalpha1_dchi1 *", "- (dalpha1_dchi1 *"),
    ("b0_hat - p->b0_prior", "b0_hat + p->b0_prior"),
    ("alpha_bar = s->dy_r", "alpha_bar = -s->dy_r"),
)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_every_mutant_of_the_update_of_estimates_is_caught(root: Path, tmp_path: Path, tally: Tally) -> None:
    leaking = ("leakage = 0.0", "leakage = 0.01\nprior   = { b0 = 2.0, d1 = 0.3 }")
    subject = variant(root, tmp_path, leaking, model="paper-adaptive")
    assert subject.compiled is not None
    export = export_c(subject.derivation, Identity("paper-adaptive", "", ""))
    prefix = export.identity.prefix
    source = export.source.replace("first = (start * ROWS) + k + 1;", "first = 0;")
    (tmp_path / f"{prefix}.h").write_text(export.files[f"{prefix}.h"], encoding="utf-8")
    for count, (old, new) in enumerate((("", ""), *LEARNT)):
        assert not old or source.count(old) == 1, old
        (tmp_path / f"{prefix}.c").write_text(source.replace(old, new) if old else source, encoding="utf-8")
        library = tmp_path / f"{count}.so"
        build = ["cc", "-std=c99", "-O0", "-ffp-contract=off", "-fPIC", "-shared", f"{prefix}.c", "-o"]
        subprocess.run([*build, str(library), "-lm"], cwd=tmp_path, check=True, capture_output=True)
        result = exported.judge(Exported.open(export, library), subject.compiled, subject.tapes, SAMPLES)
        if old:
            tally("export", new, result)
        else:
            assert result.verdict is Verdict.PASSED, result


def test_a_trace_that_names_another_line_fails_the_gate(
    paper: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = export_c

    def moved(*arguments: object) -> Export:
        export = made(*arguments)  # type: ignore[arg-type]
        entries = json.loads(export.files["trace.json"])
        entries[-1]["line"] -= 2
        export.files["trace.json"] = json.dumps(entries)
        return export

    monkeypatch.setattr(exported, "export_c", moved)
    assert exported.check(paper).verdict is Verdict.FAILED
