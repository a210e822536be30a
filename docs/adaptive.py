"""The tables of docs/adaptive.md: `python -m docs.adaptive` prints them.

Every entry comes from a run of its own. The first table is the paper's joint with wrong guesses, the second a
joint on a bench with a load, an encoder and, in its last rows, a pressure lag that the design does not know.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.errors import SimulationError
from pmjoint_codegen.simulate.estimates import estimates

MODELS = Path(__file__).resolve().parent.parent / "models"
LATE = 12.0  # s: from there on the paper's runs are late
LOST = "lost"

GUESS = "guess = { b0 = 1.2, d1 = -0.5 }"
RANGE = "range = { b0 = [0.3, 6.0], d1 = [-3.0, 3.0] }"
GAIN = "gain = { b0 = 1.0, d1 = 1.0 }"
BOTH = f'unknown = ["b0", "d1"]\n{GUESS}\n{RANGE}\n{GAIN}\nleakage = 0.0'
FORCED = f"{BOTH}\nforce = true"
LOADED = (
    'load = true\nunknown = ["b0", "d1", "w"]\nguess = { b0 = 1.2, d1 = -0.5 }\n'
    "range = { b0 = [0.3, 6.0], d1 = [-3.0, 3.0], w = [-5.0, 5.0] }\n"
    "gain = { b0 = 1.0, d1 = 1.0, w = 100.0 }\nleakage = 0.0"
)
LEAST_SQUARES = (
    f'unknown = ["b0", "d1"]\n{GUESS}\n{RANGE}\nestimator = "least_squares"\nforce = true\n'
    "least_squares = { kappa = 100.0, forgetting = 0.5, P0 = 5.0, k_max = 100.0 }"
)
FAST = {"ck1": 5.0, "ck2": 5.0}
TWO_TONES = "sin(t) + 0.5*sin(3*t)"


@dataclass(frozen=True)
class Row:
    """One design of the paper's joint.

    Attributes:
        name: as the table writes it.
        adaptation: the table [adaptation] of its file; empty for none.
        asked: of the run: its start, its compensator, its reference.
        parameters: of the run.
    """

    name: str
    adaptation: str = ""
    asked: Mapping[str, object] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)


CLIP = {"compensator": False}
MATCHED = {"start": "matched"}
ROWS = (
    Row("known law, true parameters"),
    Row("known law, wrong parameters", GUESS),
    Row("the same, clipped, true", "", CLIP),
    Row("the same, clipped, wrong", GUESS, CLIP),
    Row("adaptive, γ = 1", BOTH),
    Row("adaptive, γ = 1, c_k = 5, matched", BOTH, MATCHED, FAST),
    Row("adaptive, γ = 0.01, clipped", FORCED, CLIP, {"gamma_b0": 0.01, "gamma_d1": 0.01}),
    Row("adaptive, γ = 1, clipped", FORCED, CLIP),
    Row(
        "with a load of 1: b0, d1, w; γ = (1, 1, 100), c_k = 5, matched", LOADED, MATCHED, {**FAST, "w": 1.0}
    ),
)
TONES = (
    Row("known law, wrong parameters", GUESS, MATCHED, FAST),
    Row("adaptive, γ = 1", BOTH, MATCHED, FAST),
    Row("least squares, clipped", LEAST_SQUARES, {**MATCHED, **CLIP}),
)


@cache
def paper(
    adaptation: str, reference: str | None = None, disturbance: tuple[str, ...] | None = None
) -> ClosedLoop:
    """The paper's joint with a table [adaptation]."""
    text = (MODELS / "paper.toml").read_text(encoding="utf-8")
    return _loop(text, f"[adaptation]\n{adaptation}\n\n" if adaptation else "", reference, disturbance)


def _loop(
    text: str, adaptation: str, reference: str | None = None, disturbance: tuple[str, ...] | None = None
) -> ClosedLoop:
    """A model file with a table before its design."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.toml"
        file.write_text(text.replace("[design]", f"{adaptation}[design]", 1), encoding="utf-8")
        return ClosedLoop.load(file, reference=reference, disturbance=disturbance, notify=lambda line: None)


def run(row: Row, reference: str | None = None) -> Run | None:
    """One row's run of 20 s, or None where it does not stay bounded."""
    loop = paper(row.adaptation, reference)
    try:
        return loop.simulate(horizon=20.0, parameters=dict(row.parameters), **row.asked)  # type: ignore[arg-type]
    except SimulationError:
        return None


def cells(row: Row, reference: str | None = None) -> list[str]:
    """One line of the first table."""
    found = run(row, reference)
    if found is None:
        return [row.name, *[LOST] * 5]
    settled = found.summary["settling_s"]
    names = [item.name for item in estimates(found)]
    return [
        row.name,
        said(found.summary["ise"], 4),
        "never" if settled is None else said(settled),
        said(found.summary["max_abs_v"], 4),
        said(float(np.max(np.abs(found["e"][found["t"] >= LATE]))), 3),
        ", ".join(f"{float(found[name][-1]):.3f}" for name in names) or "–",
    ]


def said(value: float, digits: int = 3) -> str:
    """A number with so many digits."""
    return f"{float(f'{value:.{digits}g}'):.10g}"


def table(rows: Sequence[Row], reference: str | None = None) -> str:
    """The paper's joint, in Markdown."""
    head = ("design", "ISE", "settled s", "max abs v", f"late abs e, t ≥ {LATE:g} s", "Θ̂(20)")
    return markdown([head, *(cells(row, reference) for row in rows)])


def markdown(lines: Sequence[Sequence[str]]) -> str:
    """A table of lines, the first of which is its head."""
    head, *rest = lines
    whole = [head, ["---"] * len(head), *rest]
    return "\n".join(f"| {' | '.join(line)} |" for line in whole)


BENCH = """schema = 1
name   = "bench"

[parameters]
d1 = { value = -127.0, unit = "1/s^2" }
b0 = { value = 87.0, unit = "rad/(s^2 bar)" }
w  = { value = 0.0, unit = "rad/s^2" }
friction   = { value = 0.0, unit = "1/s" }
u_max      = { value = 2.5, unit = "bar" }
resolution = { value = 0.0015707963267948967, unit = "rad" }
LAG
[plant]
order = 2
Phi   = [["0", "0"], ["y", "1"]]
theta = ["d1", "w"]
b     = ["b0"]
disturbance = ["0", "-friction*x2"]

[actuator]
limit = "u_max"
VALVE
[sensor]
resolution = "resolution"

[design]
LAW
start = "matched"

[simulation]
reference   = "0.3*sin(3*t)"
x0          = [0.0, 0.0]
horizon     = 20.0
output_step = 0.001
sample_time = 0.001
"""
BACKSTEPPING = "c = [15, 15]\ne = [0.1, 0.1]\nck = [15, 15]\nk = [80, 1600]"
BELIEVED = "guess = { b0 = 87.0, d1 = -127.0, w = 0.0 }"
ENDS = "b0 = [10.0, 300.0], d1 = [-500.0, 100.0]"
ONLY_W = (
    f'unknown = ["w"]\n{BELIEVED}\nrange = {{ w = [-150.0, 150.0] }}\ngain = {{ w = 9e4 }}\nleakage = 0.0'
)
ALL = (
    f'unknown = ["b0", "d1", "w"]\n{BELIEVED}\nrange = {{ {ENDS}, w = [-150.0, 150.0] }}\n'
    "gain = { b0 = 1.5e4, d1 = 9e4, w = 9e4 }\nleakage = 0.0"
)
HEAVY = {"b0": 58.0, "d1": -127.0 / 1.5}
ROW_3 = {**HEAVY, "w": -15.0, "friction": 2.2 / 1.5}


ADRC = 'law = "adrc"\nc = [15, 15]\nobserver = 120.0'
STIFF = dict.fromkeys(("c1", "c2", "ck1", "ck2"), 30.0)
COLUMNS = ("known law", "w only, γ_w = 9e4", "b0, d1, w; γ = (1.5e4, 9e4, 9e4)")
DESIGNS = ((BELIEVED, BACKSTEPPING), (ONLY_W, BACKSTEPPING), (ALL, BACKSTEPPING), (BELIEVED, ADRC))


@dataclass(frozen=True)
class Trial:
    """What the joint on the bench is, beside what its controller takes it for.

    Attributes:
        name: as the table writes it.
        parameters: true values.
        lag: of the pressure, s; no design knows it.
        horizon: s.
        stiff: whether c = c_k = 30.
        chatter: whether u's change per sample is shown, not the error.
    """

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    lag: float = 0.0
    horizon: float = 20.0
    stiff: bool = False
    chatter: bool = False


TRIALS = (
    Trial("nominal"),
    Trial("J +50 %", HEAVY),
    Trial("J +50 %, load −15 rad/s², friction 2.2 1/s over J", ROW_3),
    Trial("b0 −54 %", {"b0": 0.46 * 87.0}),
    Trial("b0 +84 %", {"b0": 1.84 * 87.0}),
    Trial("d1 = −40", {"d1": -40.0}),
    Trial("u's change per sample, rms in bar, nominal", chatter=True),
    Trial("as row 3, with a pressure lag of 10 ms", ROW_3, lag=0.01),
    Trial("the same, after 100 s", ROW_3, lag=0.01, horizon=100.0),
    Trial("the same, c = c_k = 30", ROW_3, lag=0.01, stiff=True),
)


@cache
def bench(adaptation: str, law: str, lag: float) -> ClosedLoop:
    """The joint on a bench with a design."""
    words = {
        "LAG": f'tau = {{ value = {lag!r}, unit = "s" }}\n' if lag else "",
        "VALVE": 'lag = "tau"\n' if lag else "",
        "LAW": law,
    }
    text = BENCH
    for word, value in words.items():
        text = text.replace(word, value)
    return _loop(text, f"[adaptation]\n{adaptation}\n\n")


def trial(item: Trial, adaptation: str, law: str) -> str:
    """One entry of the second table: rms over the last 5 s, of e in degrees or of u's change."""
    if item.stiff and law == ADRC:
        return "–"
    parameters = {**item.parameters, **(STIFF if item.stiff else {})}
    try:
        found = bench(adaptation, law, item.lag).simulate(
            controller="sampled", parameters=parameters, horizon=item.horizon, divergence=1e6
        )
    except SimulationError:
        return LOST
    late = found["t"] > found["t"][-1] - 5.0
    values = np.diff(found["u"][late]) if item.chatter else np.degrees(found["e"][late])
    return f"{float(np.sqrt(np.mean(values**2))):.3f}"


def bench_table() -> str:
    """The joint on a bench, in Markdown."""
    lines = [[item.name, *(trial(item, adaptation, law) for adaptation, law in DESIGNS)] for item in TRIALS]
    return markdown([["the joint", *COLUMNS, "ADRC"], *lines])


def constant_load(**parameters: float) -> float:
    """Late |e| of the paper's joint under a constant load of 1 rad/s² and nothing else, w estimated."""
    loop = paper("load = true\ngain = { w = 100.0 }\nleakage = 0.0", disturbance=("0", "0"))
    found = loop.simulate(horizon=40.0, parameters={"w": 1.0, **parameters})
    return float(np.max(np.abs(found["e"][found["t"] >= 30.0])))


def stated() -> dict[str, str]:
    """What the page states, by name."""
    return {
        "adaptive.paper": f"\n{table(ROWS)}\n",
        "adaptive.tones": f"\n{table(TONES, TWO_TONES)}\n",
        "adaptive.bench": f"\n{bench_table()}\n",
        "adaptive.load_known": said(constant_load(gamma_w=0.0)),
        "adaptive.load": "below 1e-9" if constant_load() < 1e-9 else said(constant_load()),
        "adaptive.load_leakage": said(constant_load(leakage=0.01), 2),
    }


if __name__ == "__main__":
    print(table(ROWS), table(TONES, TWO_TONES), bench_table(), sep="\n\n")
