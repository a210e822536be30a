"""The class under GNU Octave: the host's bits, its interface, and what its run must find."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from pmjoint_codegen.errors import BuildError, CheckFailed, MissingToolError
from pmjoint_codegen.export.bindings import matlab
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.targets.target import Order, Report
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.modelfile import model_of
from pmjoint_derive import derive

from ..conftest import document

pytestmark = pytest.mark.skipif(
    shutil.which("octave-cli") is None or shutil.which("mkoctfile") is None, reason="no octave-cli, mkoctfile"
)
USE = """
function id = caught(action)
  id = 'nothing';
  try
    action();
  catch problem
    id = problem.identifier;
  end
end
function change(c, name, value)
  c.params.(name) = value;
  c.init(0.1, zeros(1, 3));
end
a = pmjoint_paper(); b = pmjoint_paper();
r = zeros(1, 3);
printf('%s\\n', caught(@() a.step(1, r)));
a.init(0.2, r); b.init(0.2, r);
a.step(0.2, r);
saved = a.save_state();
first = a.step(0.1, r);
b.step(0.2, r);
second = b.step(0.1, r);
printf('apart %d\\n', isequal(first, second));
a.restore_state(saved);
printf('restored %d\\n', isequal(a.step(0.1, r), first));
a.restore_state(saved);
printf('measured %d\\n', isequal(a.step(0.1, r, 0.5), first));
printf('nan %d\\n', a.step(NaN, r).flags == pmjoint_paper.BAD_INPUT);
a.reset(0.2, r); a.step(0.2, r);
printf('reset %d\\n', isequal(a.step(0.1, r), first));
printf('%s\\n', caught(@() a.step('x', r)));
printf('%s\\n', caught(@() a.step(1, zeros(1, 2))));
printf('%s\\n', caught(@() a.step(1, complex(r, 1))));
printf('%s\\n', caught(@() a.step(1, r, [1, 2])));
printf('%s\\n', caught(@() a.step(1, r, 2, 3)));
printf('%s\\n', caught(@() a.restore_state(uint8([1, 2, 3]))));
printf('%s\\n', caught(@() pmjoint_paper_mex('nonsense')));
printf('%s\\n', caught(@() pmjoint_paper_mex()));
printf('%s\\n', caught(@() change(a, 'unknown', 1)));
a = pmjoint_paper();
printf('%s\\n', caught(@() change(a, 'd1', 'text')));
a = pmjoint_paper();
a.params.sample_time = -1;
printf('bad %d\\n', a.init(0.2, r) == pmjoint_paper.BAD_PARAMETER);
printf('%s\\n', caught(@() a.step(1, r)));
"""


@dataclass(frozen=True)
class Built:
    """An export on disk, built and run."""

    order: Order
    folder: Path
    report: Report


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """Export the paper's model, and run it once."""
    contents = document("paper")
    derivation = derive(model_of(contents, "paper"))
    identity = Identity(contents["name"], "0" * 64, "test")
    order = Order(derivation, identity, contents, DOUBLE, os.environ, Path("paper.toml").absolute())
    folder = tmp_path_factory.mktemp("paper")
    for place, data in matlab.deliver(order).files.items():
        assert isinstance(data, str)
        (folder / place).write_text(data)
    return Built(order, folder, matlab.run(order, folder))


def test_recorded_samples_have_the_bits_of_this_machine(built: Built) -> None:
    record = built.report.record
    assert record["samples"] == 10_000 and record["values"] == 160_000
    assert record["other_bits"] == 0 and record["library_functions"] == []


def test_objects_are_apart_and_wrong_arguments_are_errors(built: Built) -> None:
    script = built.folder / "use.m"
    script.write_text("1;\n" + USE)
    command = ["octave-cli", "--norc", "--quiet", "use.m"]
    done = subprocess.run(command, cwd=built.folder, capture_output=True, text=True, check=False)
    order, wrong = "pmjoint_paper:order", "pmjoint_paper:arguments"
    assert done.stdout.splitlines() == [
        order,
        *("apart 1", "restored 1", "measured 0", "nan 1", "reset 1"),
        *[wrong] * 10,
        *("bad 1", order),
    ], done.stderr


def test_one_other_parameter_is_noticed(built: Built, tmp_path: Path) -> None:
    folder = shutil.copytree(built.folder, tmp_path / "changed")
    file = folder / "pmjoint_paper.m"
    text = file.read_text()
    given = "self.params = pmjoint_paper_mex('defaults');"
    assert text.count(given) == 1
    file.write_text(text.replace(given, f"{given} self.params.d1 *= 1 + 2 ^ -40;"))
    with pytest.raises(CheckFailed, match="other bits"):
        matlab.run(built.order, folder)


def test_what_does_not_build_is_said_with_the_compilers_text(built: Built, tmp_path: Path) -> None:
    folder = shutil.copytree(built.folder, tmp_path / "broken")
    (folder / "pmjoint_paper_mex.c").write_text("int broken")
    with pytest.raises(BuildError) as caught:
        matlab.run(built.order, folder)
    assert "pmjoint_paper_mex.c" in caught.value.output


def test_without_octave_one_line_names_it(built: Built, tmp_path: Path) -> None:
    order = replace(built.order, environment={"PATH": str(tmp_path)})
    with pytest.raises(MissingToolError, match="apt-get install octave octave-dev"):
        matlab.run(order, built.folder)
