"""The forms of a derivation: text that runs, LaTeX that compiles, Markdown and JSON that say the same."""

from __future__ import annotations

import difflib
import json
import random
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.report.latex import latex_report
from pmjoint_codegen.report.markdown import markdown_report
from pmjoint_codegen.report.record import derivation_record
from pmjoint_codegen.report.text import text_report
from pmjoint_derive import Derivation, Gains, Model, Parameter, Plant, Simulation, derive, real_symbol
from pmjoint_derive.certificate import certificate_equations
from pmjoint_derive.equation import Equation, Equations

MODELS = Path(__file__).resolve().parents[2] / "models"
ZERO = sp.Integer(0)


def model(n: int, rho: int) -> Model:
    """Return a plant of order n and relative degree rho, nonlinear in y where that is not the paper's own."""
    y, d1, b0, u_max = (real_symbol(name) for name in ("y", "d1", "b0", "u_max"))
    plain = (n, rho) == (2, 2)
    plant = Plant(
        order=n,
        phi=(ZERO,) * n if plain else (sp.sin(y), *(ZERO,) * (n - 1)),
        Phi=(*((ZERO,),) * (n - 1), (y,)),
        theta=(d1,),
        b=(b0, *(sp.Integer(3),) * (n - rho)),
        sigma=sp.Integer(1) if plain else 1 + y**2,
        disturbance=(*(ZERO,) * (n - 1), sp.Rational(1, 10) * sp.cos(real_symbol("t"))),
    )
    return Model(
        name="joint_1",
        title="A joint & its 100 % muscle, with ϑ",
        source="made up",
        parameters=(
            Parameter("d1", 0.2, "1/s^2", "stiffness term (8)"),
            Parameter("b0", 2.0, "rad/(s^2 V)", "input gain (8)"),
            Parameter("u_max", 10.0, "V", "actuator limit u_M (10)"),
        ),
        plant=plant,
        limit=u_max,
        reference=sp.sin(real_symbol("t")),
        gains=Gains((15.0,) * rho, (0.1,) * rho, (1.0,) * rho, (6.0, 11.0, 6.0)[:n]),
        simulation=Simulation((1.5, *(0.0,) * (n - 1)), 20.0, 0.01, 0.001),
    )


@pytest.fixture(scope="module", params=[(2, 2), (3, 3), (2, 1)], ids=["paper", "third-order", "with-zero"])
def derivation(request: pytest.FixtureRequest) -> Derivation:
    """Return a derivation of the paper's class, one of order 3, and one with zero dynamics."""
    return derive(model(*request.param))


def test_every_line_of_the_text_runs_as_code_and_gives_the_law(derivation: Derivation) -> None:
    """Run the printed Backstepping section; its v is the expanded law at a random point."""
    text = text_report(derivation.model, derivation.equations.values())
    section = text.partition("# Backstepping\n")[2].partition("# Certificate\n")[0]
    expanded = derivation.expanded("v")
    draw = random.Random(1)
    point = {
        symbol: sp.Rational(draw.randint(1, 99), 10) for symbol in sorted(expanded.free_symbols, key=str)
    }
    names: dict[str, object] = {
        "sin": sp.sin,
        "cos": sp.cos,
        **{symbol.name: value for symbol, value in point.items()},
    }
    exec(compile(section, "derivation", "exec"), names)
    assert sp.expand(names["v"] - expanded.xreplace(point)) == 0  # exact: rational numbers, and sin of them


def test_the_printed_certificate_runs_as_code_and_gives_the_rate_of_v(derivation: Derivation) -> None:
    certificate = certificate_equations(derivation)
    equations = (*derivation.equations.values(), *certificate)
    text = text_report(derivation.model, equations)
    section = text.partition("# Certificate\n")[2].partition("# Closed loop\n")[0]
    given = {
        name for item in equations if item.section == "Certificate" for name in item.expression.free_symbols
    }
    draw = random.Random(1)
    point = {
        symbol: sp.Rational(draw.randint(1, 99), 10)
        for symbol in sorted(given, key=str)
        if symbol.name not in {item.name for item in certificate}
    }
    names: dict[str, object] = {symbol.name: value for symbol, value in point.items()}
    exec(compile(section, "certificate", "exec"), names)
    rate = Equations(certificate).expand(real_symbol("V_dot")).xreplace(point)
    assert names["V_dot"] == rate  # exact: rational numbers
    record: Any = derivation_record(derivation.model, equations)
    said = {item["name"]: item for item in record["equations"]}
    assert (said["V"]["number"], said["V_dot"]["symbol"], said["V_epsilon"]["symbol"]) == (
        "(30)", r"\dot{V}", r"V_{\epsilon}"
    )  # fmt: skip
    assert r"\dot{V} =" in latex_report(derivation.model, equations)


def test_the_true_plants_own_values_are_defined_before_they_are_used(derivation: Derivation) -> None:
    """In every form: as the controller's, which they equal where nobody sets others."""
    own = {twin.name: name.name for name, twin in derivation.own_parameters.items()}
    assert own
    equations = tuple(derivation.equations.values())
    section = text_report(derivation.model, equations).partition("# True plant\n")[2]
    names = [line.partition(" = ")[0] for line in section.splitlines()]
    for twin, name in own.items():
        assert f"\n{twin} = {name} " in section
        first = next(
            k for k, line in enumerate(section.splitlines()) if f"{twin}*" in line or f"*{twin}" in line
        )
        assert names.index(twin) < first
    assert latex_report(derivation.model, equations).count("the plant has what the controller believes") == 1
    assert derivation_record(derivation.model, equations)["true_plant"] == own


def test_gains_switch_and_held_matrices_are_said_in_every_form(derivation: Derivation) -> None:
    """What an equation uses and no equation defines: a number or an explanation stands beside it."""
    equations = tuple(derivation.equations.values())
    text, latex = (form(derivation.model, equations) for form in (text_report, latex_report))
    gains, latex = derivation.model.gains, latex.replace(r",\allowbreak", ",")
    assert f"$k = ({', '.join(f'{x:g}' for x in gains.k)})$" in latex and "$s_r = 1$" in latex
    assert "expm(A0 T)" in text and "F_0 = e^{A_0 T}" in latex


def test_the_whole_text_is_python(derivation: Derivation) -> None:
    compile(text_report(derivation.model, derivation.equations.values()), "derivation", "exec")


def test_text_names_every_equation_with_its_number_meaning_and_unit(derivation: Derivation) -> None:
    lines = text_report(derivation.model, derivation.equations.values()).splitlines()
    for equation in derivation.equations.values():
        place = next(k for k, line in enumerate(lines) if line.startswith(f"{equation.name} = "))
        said = lines[place - 1] + lines[place]
        assert equation.number in said
        assert equation.meaning in said
        assert equation.unit is None or str(equation.unit) == "1" or f"[{equation.unit}]" in said


def test_sections_stand_in_a_readers_order(derivation: Derivation) -> None:
    text = text_report(derivation.model, derivation.equations.values())
    order = [
        "Plant",
        "Filters",
        "Estimate",
        "Compensator",
        "Reference",
        "Backstepping",
        "Certificate",
        "Closed loop",
    ]
    places = [text.index(f"# {section}\n") for section in order]
    assert places == sorted(places)


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex")
def test_latex_compiles_without_a_line_that_is_too_wide(derivation: Derivation, tmp_path: Path) -> None:
    compile_latex(derivation, tmp_path)


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex")
@pytest.mark.parametrize("file", sorted(MODELS.rglob("*.toml")), ids=lambda file: file.stem)
def test_latex_of_every_shipped_model_stays_within_the_page(file: Path, tmp_path: Path) -> None:
    """Their sources are long, and physics in the plant's own values makes long products."""
    compile_latex(derive(model_of(read_document(file), file.name)), tmp_path)


KNOWN_LAW = "[design]\nc  = [15, 15]\ne  = [0.1, 0.1]\nck = [1, 1]\nk  = [6, 8]\ncompensator = true"
ESTIMATED = """[adaptation]
load    = true
unknown = ["b0", "d1", "w"]
guess   = { b0 = 1.2, d1 = -0.5 }
range   = { d1 = [-3.0, 3.0], w = [-5.0, 5.0]"""
VARIANTS = {
    "inverse": (
        f'{ESTIMATED} }}\ngain = {{ b0 = 1.0 }}\nform = "inverse"\ninverse = {{ gain = 0.1 }}\n{KNOWN_LAW}',
        (r"The estimate $\hat{\varrho}$ of $1/b_m$ has $\varrho_{\mathrm{guess}}", r"\dot{\hat{\varrho}} ="),
    ),
    "least squares": (
        f'{ESTIMATED}, b0 = [0.3, 6.0] }}\nestimator = "least_squares"\n{KNOWN_LAW}\nstart = "matched"',
        (r"Least squares with $\kappa = 100$, $\beta = 0.5$", r"\epsilon_y = y - \hat{x}_1"),
    ),
    "ADRC": (
        '[design]\nlaw = "adrc"\nc = [15, 15]\nobserver = 120.0',
        (r"poles at $-\omega_o$, $\omega_o = 120$", r"\dot{\hat{\eta}}_3 = \omega_o^{3}"),
    ),
}


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex")
@pytest.mark.parametrize("variant", list(VARIANTS))
def test_latex_of_other_designs_stays_within_the_page(variant: str, tmp_path: Path) -> None:
    """Designs that no shipped model has, each with its settings and symbols."""
    design, said = VARIANTS[variant]
    text = (MODELS / "paper.toml").read_text(encoding="utf-8")
    text, found = re.subn(
        r"^\[design\]\n.*?(?=^\[simulation\])",
        lambda _: f"{design}\n\n",
        text,
        flags=re.DOTALL | re.MULTILINE,
    )
    assert found == 1
    (tmp_path / "variant.toml").write_text(text, encoding="utf-8")
    source = compile_latex(derive(model_of(read_document(tmp_path / "variant.toml"), variant)), tmp_path)
    assert [line for line in said if line not in source] == []


def compile_latex(derivation: Derivation, tmp_path: Path) -> str:
    """Run LaTeX; nothing may be too wide or undefined.

    Returns:
        the source.
    """
    equations = (*derivation.equations.values(), *derivation.design.certificate(derivation))
    source = latex_report(derivation.model, equations)
    (tmp_path / "derivation.tex").write_text(source, encoding="utf-8")
    run = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "derivation.tex"]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, errors="replace", check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout
    assert "undefined" not in done.stdout
    assert ": ." not in source  # a list of nothing
    return source


def test_latex_environments_and_braces_are_balanced(derivation: Derivation) -> None:
    source = latex_report(derivation.model, derivation.equations.values())
    for environment in ("equation", "equation*", "aligned", "document", "tabularx"):
        assert source.count(rf"\begin{{{environment}}}") == source.count(rf"\end{{{environment}}}")
    plain = source.replace(r"\{", "").replace(r"\}", "")
    assert plain.count("{") == plain.count("}")


def test_markdown_has_each_equation_of_the_latex_behind_its_name(derivation: Derivation) -> None:
    equations = (*derivation.equations.values(), *certificate_equations(derivation))
    page = markdown_report(derivation.model, equations)
    shown = re.findall(r"^`(\w+)`( \([^:]+\))?: .+\n\n```math\n((?:.+\n)+)```$", page, re.MULTILINE)
    assert {(name, number.strip()) for name, number, _ in shown} == {
        (item.name, item.number) for item in equations
    }
    assert len(shown) == len(equations) == page.count("```math")
    document = latex_report(derivation.model, equations).replace("\n\\\\ &", "")
    assert [rows for _, _, rows in shown if rows.replace("\n\\\\ &", "") not in document] == []
    for section in {item.section for item in equations}:
        assert f"\n## {section}\n" in page


@pytest.mark.parametrize("place", [0, 3, -1], ids=["first", "middle", "last"])
def test_markdown_shows_a_changed_term_as_one_changed_line(place: int) -> None:
    names = [f"w{i:02d}" for i in range(1, 25)]
    terms = [real_symbol(name) * real_symbol("delta") ** 3 for name in names]
    law = Equation(real_symbol("v"), ZERO, "Backstepping", "(29)", "law", None)
    longer = list(terms)
    longer[place] *= sp.Rational(355, 113)  # long enough to move what follows, where lines are filled
    pages = [
        markdown_report(model(2, 2), [replace(law, expression=sum(some, ZERO))]) for some in (terms, longer)
    ]
    lines = difflib.ndiff(pages[0].splitlines(), pages[1].splitlines())
    changed = [line for line in lines if line[0] in "+-"]
    assert [line[0] for line in changed] == ["-", "+"]
    assert "355" in changed[1]


@pytest.mark.parametrize("file", sorted(MODELS.glob("*.toml")), ids=lambda file: file.stem)
def test_markdown_of_a_shipped_model_renders_on_github(file: Path) -> None:
    """GitHub refuses some macros, and takes underscores and backslashes outside code for markup."""
    page = (MODELS.parent / "generated" / file.stem / "derivation.md").read_text(encoding="utf-8")
    assert "operatorname" not in page and "$$" not in page
    prose = re.sub(r"<!--.*?-->|```math\n.*?\n```", "", page, flags=re.DOTALL)
    bare, symbols = re.subn(r"\$`[^`$]+`\$", "", prose)
    assert symbols > 50
    assert re.findall(r"(?<!\\)[$`*_<]", re.sub(r"`\w+`", "", bare)) == []
    formulas = re.findall(r"```math\n(.*?)\n```", page, re.DOTALL)
    assert all(line.strip() for formula in formulas for line in formula.splitlines())


def test_markdown_keeps_what_the_user_wrote_from_becoming_markup() -> None:
    title, about = "a_b --> <b>*x*</b> | `c`", "50 % of u_max | 2 N at\tmost"
    text = replace(model(2, 2), title=title, parameters=(Parameter("d1", 0.1, "N_x", about),))
    page = markdown_report(text, (), [title])
    assert page.startswith(
        "<!-- a_b - - > <b>*x*</b> | `c` -->\n\n# a\\_b --\\> \\<b\\>\\*x\\*\\</b\\> \\| \\`c\\`\n"
    )
    assert "| `d1` | $`d_1`$ | 0.1 | N\\_x | 50 % of $`u_{\\max}`$ \\| 2 N at most |\n" in page


def test_record_holds_every_equation_as_expressions_that_parse_back(derivation: Derivation) -> None:
    record = json.loads(json.dumps(derivation_record(derivation.model, derivation.equations.values())))
    assert record["relative_degree"] == derivation.plant.rho
    assert [item["name"] for item in record["equations"]] == list(derivation.equations)
    for item in record["equations"]:
        equation = derivation.equations[item["name"]]
        names = {symbol.name: symbol for symbol in equation.expression.free_symbols}
        text = item["expression"].replace("max(", "Max(").replace("min(", "Min(")
        assert sp.simplify(sp.sympify(text, locals=names) - equation.expression) == 0
