"""Each block of docs/howto/look-at-runs-with-other-tools.md runs, and the page names what there is."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.logs.formats import FORMATS
from pmjoint_codegen.simulate.trajectory import trajectory_of

ROOT = Path(__file__).resolve().parent.parent.parent
PAGE = (ROOT / "docs" / "howto" / "look-at-runs-with-other-tools.md").read_text(encoding="utf-8")
BLOCKS: dict[str, list[str]] = {
    language: re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    for language in ("python", "octave")
}
# Octave without a display cannot plot: the data that it would draw are printed.
UNDRAWN = """
function plot(varargin) printf('%d points of %d curves\\n', numel(varargin{2}), numel(varargin) / 2); end
function xlabel(text) disp(text), end
function ylabel(text) disp(text), end
"""


def test_the_python_blocks_run_and_octave_reads_what_they_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for package in ("mcap", "pandas", "pyarrow"):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    assert len(BLOCKS["python"]) == 2
    for block in BLOCKS["python"]:
        exec(block, names)  # the page's own text
    run = names["run"]
    assert isinstance(run, Run)
    assert capsys.readouterr().out == f"{abs(run['e']).max()} rad\n"
    octave = shutil.which("octave-cli")
    if octave is None:
        pytest.skip("GNU Octave is not installed: octave-cli")
    script = UNDRAWN + BLOCKS["octave"][0]
    done = subprocess.run(
        [octave, "--norc", "-q", "--eval", script],
        capture_output=True,
        encoding="utf-8",
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("501 points of 2 curves\nt (s)\ny (rad)\n")
    assert "tracking error, e = z1 + r1" in done.stdout
    assert f"paper, c1 = 15 1/s, ISE {run.ise:.3f}" in done.stdout


def test_the_page_lists_every_format_and_topic() -> None:
    rows = re.findall(r"^\| `(\w+)` \|(.*)\|$", PAGE, re.MULTILINE)
    assert [name for name, _ in rows] == [item.name for item in FORMATS]
    assert [bool(item.package) for item in FORMATS] == ["[logs]" in row for _, row in rows]
    made = trajectory_of(ClosedLoop.load("paper").simulate(horizon=0.1))
    assert re.findall(r"`/(\w+)`", PAGE) == list(made.groups)
