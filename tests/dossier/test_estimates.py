"""What a report says of controllers that estimate, of a plant of order one, and of a run that failed."""

from __future__ import annotations

import html
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from pmjoint_codegen.check.gates.proof import design_values, prove_for
from pmjoint_codegen.check.oracles.truth import decay
from pmjoint_codegen.dossier import facts as gathered
from pmjoint_codegen.dossier.chapters.limits import limits
from pmjoint_codegen.dossier.chapters.model import assumptions
from pmjoint_codegen.dossier.chapters.proof import proof_chapter
from pmjoint_codegen.dossier.chapters.runs import run_chapter, words_of
from pmjoint_codegen.dossier.facts import Absent, Decay, Facts, gather
from pmjoint_codegen.dossier.page import model_page
from pmjoint_codegen.dossier.region import Map

ROOT = Path(__file__).parents[2]
KNOWS_ALL = "The controller knows its parameters."
Report = Callable[[str], Facts]


def edited(text: str, *pairs: tuple[str, str]) -> str:
    """Replace parts of a model file."""
    for old, new in pairs:
        assert re.search(old, text, re.DOTALL), old
        text = re.sub(old, new, text, count=1, flags=re.DOTALL)
    return text


def texts() -> Mapping[str, str]:
    """Model files by name."""
    first, load = (
        (ROOT / "tests" / "reference" / f"adaptive-{name}.toml").read_text(encoding="utf-8")
        for name in ("first-order", "load")
    )
    shorter = (r"horizon     = 20.0", "horizon     = 2.0")
    guess = (r"\[adaptation\].*\[design\]", "[adaptation]\nguess = { b0 = 1.2 }\n\n[design]")
    tuned = (r"leakage = 0.0", "")
    gains = (r"gain    = [^\n]*", 'estimator = "least_squares"')
    frozen = (r"gain    = \{ b0 = 1.0", "gain    = { b0 = 0.0")
    found = {
        "one": edited(first, shorter),
        "one-known": edited(first, shorter, (r"\[adaptation\].*\[design\]", "[design]")),
        "one-guess": edited(first, shorter, guess),
        "squares": edited(first, shorter, tuned, gains, (r"k  = \[4\]", 'k  = [4]\nstart = "matched"')),
        "half-frozen": edited(first, shorter, frozen),
        "load": edited(load, shorter),
    }
    return {name: edited(text, (r'name   = "[^"]*"', f'name   = "{name}"')) for name, text in found.items()}


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Report:
    folder, made = tmp_path_factory.mktemp("models"), dict[str, Facts]()

    def facts(name: str) -> Facts:
        if name not in made:
            file = folder / f"{name}.toml"
            file.write_text(texts()[name], encoding="utf-8")
            made[name] = gather(file, environment=os.environ, notify=lambda line: None)
        return made[name]

    return facts


def words(markup: str) -> str:
    """The text of a page."""
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", markup)).split())


@pytest.mark.parametrize("name", ["one", "one-known"])
def test_a_plant_of_order_one_has_a_region_over_its_one_state(name: str, report: Report) -> None:
    facts = report(name)
    assert isinstance(facts.region, Map) and not facts.region.plane
    assert facts.region.command.count("--grid") == 1 and facts.region.runs == 32
    text = words(model_page(facts))
    assert "A curve has a gap where the output diverges" in text and "Colour: settling" not in text


def test_what_is_estimated_or_guessed_is_not_said_to_be_known(report: Report) -> None:
    said = {name: words(" ".join(assumptions(report(name)))) for name in ("one", "one-known", "one-guess")}
    assert KNOWS_ALL in said["one-known"]
    assert KNOWS_ALL not in said["one"] + said["one-guess"]
    unknown = "The controller does not know b 0 : it"
    assert f"{unknown} estimates it from 1.2 rad/(s V) on." in said["one"]
    assert f"{unknown} takes it to be 1.2 rad/(s V), for good." in said["one-guess"]


def test_leakage_with_constant_gains_has_the_rate_that_the_gate_judges(report: Report) -> None:
    facts = report("load")
    f, Y = decay(facts.subject.model, design_values(facts.derivation), 0.1, disturbs_y=False)
    assert facts.certificate == Decay(f, Y) and f > 0
    text = words(proof_chapter(facts))
    assert "Not here" not in text and "V decreases up to the effects of the disturbance" in text
    assert f"f (1/s) {f:.4g}" in text


def test_ranges_leave_no_rate_and_the_page_says_why(report: Report) -> None:
    facts = report("one")
    assert isinstance(facts.certificate, Absent) and "without ranges" in facts.certificate.reason
    assert "V does not rise, but for the effects" in words(proof_chapter(facts))


@pytest.mark.parametrize(
    ("name", "reason"), [("squares", "least squares together with the law"), ("half-frozen", "b0: estimated")]
)
def test_no_v_is_claimed_where_there_is_none(name: str, reason: str, report: Report) -> None:
    facts = report(name)
    text, listed = words(proof_chapter(facts)), words(" ".join(limits(facts)))
    assert "Nothing is claimed of a Lyapunov function" in text and reason in text
    assert "V does not rise" not in text and "squares with positive factors" not in text
    assert "identities of the proof bound nothing" in listed and "ranges of their estimates" not in listed
    detail = prove_for(facts.derivation, design_values(facts.derivation)).detail
    assert reason in detail and "V does not rise" not in detail


def test_the_compensator_of_a_design_with_estimates_is_chi(report: Report) -> None:
    assert "state χ while" in words(" ".join(limits(report("one"))))
    assert "state r while" in words(" ".join(limits(report("one-known"))))


def test_a_comparison_that_failed_is_said_to_have_failed(
    report: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    facts = report("one")
    reason = Absent("a run that did not come about")
    monkeypatch.setattr(gathered, "_run", lambda *_args, **_asked: reason)
    assert gathered._frozen(None, facts.run) is reason  # type: ignore[arg-type]  # what it would run is replaced
    told = replace(facts, frozen=reason)
    for page in (run_chapter(told), " ".join(limits(told))):
        assert reason.reason in words(page)
    assert "no error without adaptation" not in words(run_chapter(facts))


def test_captions_have_no_names_of_tex() -> None:
    assert words_of(r"$\hat{\varrho}$ and $\chi_1$") == "rho and chi_1"
