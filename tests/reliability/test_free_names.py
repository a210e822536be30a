"""A plant's parameters may bear any free name: names are labels, and no number depends on them.

The same plant is written twice, once with drawn names and once with plain ones. A plain name is the drawn one
followed by 0, which sorts among the other symbols just as the drawn one does: SymPy orders terms by name,
and another order of additions would round differently.
"""

from __future__ import annotations

import ast
import io
import json
import math
import os
import re
import zlib
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import load_subject
from pmjoint_codegen.check.table import run_gates, select
from pmjoint_codegen.cli.main import run as run_command
from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.emit.regenerate import regenerate
from pmjoint_codegen.modelfile.names import why_not

FREED = ("e", "g", "h", "p", "s", "w")
LETTERS = tuple("abcdefghijklmnopqrsxz") + tuple("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
WORDS = (
    "theta",
    "sigma",
    "phi",
    "tau",
    "lamda",
    "int",
    "double",
    "limit",
    "horizon",
    "ise2",
    "opaque_0",
    "s2",
)
TEMPLATE = """\
schema = 1
name   = "pendulum"
title  = "Pendulum with a name in every place"
[parameters]
{mass}    = {{ value = 0.7, unit = "kg", about = "mass" }}
{length}  = {{ value = 0.9, unit = "m", about = "length" }}
{gravity} = {{ value = 9.81, unit = "m/s^2", about = "gravity" }}
{damping} = {{ value = 0.3, unit = "1/s", about = "damping" }}
{gain}    = {{ value = 0.2, unit = "1", about = "of the input" }}
{bound}   = {{ value = 12.0, unit = "N m", about = "limit" }}
{size}    = {{ value = 0.4, unit = "rad", about = "of the reference" }}
{push}    = {{ value = 0.1, unit = "1/s^2", about = "of the disturbance" }}
[plant]
order = 2
phi   = ["-{damping}*y", "-{gravity}*sin(y)"]
Phi   = [["0"], ["y"]]
theta = ["exp(1)/{length}"]
b     = ["1/({mass}*{length}**2)"]
sigma = "1 + {gain}*y**2"
disturbance = ["0", "{push}*abs(sin(3*t))"]
disturbance_bound = 0.1
[actuator]
limit = "{bound}"
[design]
c = [3, 3]
e = [0.1, 0.1]
ck = [2, 2]
k = [20, 100]
[simulation]
reference   = "{size}*(1 - cos(t))"
x0          = [0.2, 0.0]
horizon     = 1.0
output_step = 0.05
sample_time = 0.01
"""
ROLES = re.findall(r"^\{(\w+)\}", TEMPLATE, flags=re.MULTILINE)
GATES = ("current", "proof", "interpreter", "symbolic", "derivatives", "trajectory")

pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="kernels and sweeps are compiled")


@st.composite
def drawn_names(draw: st.DrawFn) -> tuple[str, ...]:
    """A name for every role, three of them of those that the paper's notation uses otherwise."""
    first = draw(st.lists(st.sampled_from(FREED), min_size=3, max_size=3, unique=True))
    rest = st.sampled_from([name for name in (*LETTERS, *WORDS) if name not in first])
    more = draw(st.lists(rest, min_size=len(ROLES) - 3, max_size=len(ROLES) - 3, unique=True))
    return tuple(draw(st.permutations([*first, *more])))


def write(folder: Path, names: tuple[str, ...]) -> Path:
    file = folder / "models" / "pendulum.toml"
    file.parent.mkdir(parents=True)
    file.write_text(TEMPLATE.format(**dict(zip(ROLES, names, strict=True))))
    return file


def operations(file: Path, name: str) -> str:
    """A generated file without its banner, which has the hash of the model's structure."""
    text = (file.parents[1] / "generated" / "pendulum" / name).read_text()
    return re.sub(r"structure [0-9a-f]{16}", "", text)


class Values(Mapping[str, float]):
    """Values by name for a pasted derivation; what it does not assign, such as a state, has a fixed one."""

    def __init__(self) -> None:
        self.assigned: dict[str, float] = {}

    def __getitem__(self, name: str) -> float:
        if name not in self.assigned and hasattr(math, name):
            raise KeyError(name)  # a function
        if name in ("abs", "min", "max"):
            raise KeyError(name)
        return self.assigned.get(name, 0.5 + zlib.crc32(name.encode()) / 2**32)

    def __setitem__(self, name: str, value: float) -> None:
        self.assigned[name] = value

    def __iter__(self) -> Iterator[str]:
        return iter(self.assigned)

    def __len__(self) -> int:
        return len(self.assigned)


def pasted(text: str) -> dict[str, float]:
    """What the assignments of a derivation as text compute, in order."""
    values = Values()
    exec(compile(ast.parse(text), "derivation", "exec"), dict(vars(math)), values)
    return values.assigned


def printed(*arguments: str) -> str:
    """What a command prints; it must succeed."""
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as complaints:
        code = run_command(list(arguments))
    assert code == 0, complaints.getvalue()
    return out.getvalue()


def in_plain_names(text: str, plain: Mapping[str, str]) -> str:
    return re.sub(r"[A-Za-z]\w*", lambda word: _plain(word[0], plain), text)


def _plain(word: str, plain: Mapping[str, str]) -> str:
    stem = word.removesuffix("_plant")
    return plain.get(stem, stem) + word[len(stem) :]


def table(file: Path, folder: Path) -> Mapping[str, npt.NDArray[np.float64]]:
    """The dataset of a sweep over two parameters of the plant and one of its own values."""
    from pmjoint_codegen.sweep.dataset import read

    names = [line.split()[0] for line in file.read_text().splitlines() if " about = " in line]
    grid = [
        f"--grid={names[0]}=0.6,0.8",
        f"--grid={names[3]}=0.2,0.4",
        f"--sample={names[2]}_plant~normal(9,1)",
    ]
    options = ["--runs=2", f"--set={names[7]}=0.2", "--out", str(folder), "--no-figures", "--json"]
    printed("sweep", str(file), *grid, *options)
    data = read(folder / "sweep.zarr")
    return {name: np.asarray(data[name]) for name in ("ise", "max_abs_e", "status", "final_x1", "final_r2")}


@settings(max_examples=2, phases=(Phase.explicit, Phase.reuse, Phase.generate))  # each takes 15 s
@given(names=drawn_names())
def test_no_number_depends_on_a_name(
    names: tuple[str, ...], tmp_path_factory: pytest.TempPathFactory
) -> None:
    assert [why_not(name) for name in names] == [None] * len(ROLES)
    folder = tmp_path_factory.mktemp("names")
    plain = {name: f"{name}0" for name in names}
    files = [write(folder / "drawn", names), write(folder / "plain", tuple(plain.values()))]
    for file in files:
        regenerate([str(file)])
    for name in ("kernels.tape", "kernels.c", "loops.c", "sampled.h", "lanes.c"):
        assert operations(files[0], name) == operations(files[1], name), name

    drawn, twin = (ClosedLoop.load(file, notify=lambda line: None) for file in files)
    changes = {names[0]: 0.8, f"{names[2]}_plant": 9.0, names[5]: 4.0}
    for controller in ("continuous", "sampled"):
        first = drawn.simulate(controller=controller, parameters=changes)
        second = twin.simulate(
            controller=controller, parameters={_plain(name, plain): value for name, value in changes.items()}
        )
        assert np.array_equal(first.states, second.states) and np.array_equal(first.signals, second.signals)
        summaries = first.summary, second.summary
        assert list(summaries[0]["parameters"].values()) == list(summaries[1]["parameters"].values())
        assert list(summaries[0]["units"].values()) == list(summaries[1]["units"].values())
        assert summaries[0]["units"]["e"] == "rad"  # the column's; a parameter's is that of "parameter e"

    found = [table(file, folder / f"sweep{place}") for place, file in enumerate(files)]
    for name in found[0]:
        assert np.array_equal(found[0][name], found[1][name], equal_nan=True), name

    records = [json.loads(printed("derive", str(file), "--format", "json")) for file in files]
    for one, two in zip(*(record["equations"] for record in records), strict=True):
        # The certificate speaks of no parameter; beside a parameter V, its own V is called V_of_V.
        own = one["section"] == "Certificate"
        text = one["expression"].replace("_of_V", "") if own else in_plain_names(one["expression"], plain)
        assert text == two["expression"], one["name"]
    numbers = [pasted(printed("derive", str(file))) for file in files]
    assert list(numbers[0].values()) == list(numbers[1].values())
    assert ("e_y" in numbers[0]) == ("e" in names)
    for form in ("latex", "markdown"):
        assert len(printed("derive", str(files[0]), "--format", form)) > 5000

    subject = load_subject(files[0], os.environ, lambda line: None)
    results = {result.name: result for result in run_gates(subject, select(GATES))}
    failed = {name: item.detail for name, item in results.items() if item.verdict is Verdict.FAILED}
    assert failed == {}
