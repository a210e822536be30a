"""The page in a browser against `pmjoint simulate`: the same runs, to 1e-9; its link, its words, its pace."""

from __future__ import annotations

import html
import importlib.util
import json
import os
import random
import re
import shutil
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.closed_loop import Source, evaluator_of
from pmjoint_codegen.explorer.page import Page, Prepared, make_page, prepare
from pmjoint_codegen.workspace import find_model

BROWSER = shutil.which("chromium")
RUNS = 20
TOLERANCE = 1e-9  # of every column, relative to max(1, |value|): a run's own local error is 1e-10
COLUMNS = ("y", "y_r", "e", "x1", "x2", "r1", "r2", "z1", "z2", "v", "u", "x_hat1", "x_hat2")
EVERY = 100  # of the rows are compared
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--virtual-time-budget=60000",
    "--dump-dom",
]

pytestmark = [
    pytest.mark.skipif(BROWSER is None, reason="chromium is not installed"),
    pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed"),
]

# It runs in the page, after its own scripts, and leaves its findings in the document.
PROBE = """
<script>
(async () => {
  const asked = @asked@, columns = @columns@, every = @every@, found = [];
  while (document.documentElement.dataset.ready !== "yes") await new Promise((go) => setTimeout(go, 5));
  const page = window.explorer;
  for (const change of asked) {
    const settings = Object.assign(defaultSettings(page.data), change);
    const run = page.simulate(settings);
    const thin = (name) => [...run.column(name)].filter((_, i) => i % every === 0);
    const kept = Object.fromEntries(columns.map((name) => [name, thin(name)]));
    const again = fromHash(page.data, toHash(page.data, settings));
    found.push({columns: kept, status: run.status, ise: run.ise,
      saturated: run.saturated, switches: run.switches,
      peak: run.peak("v")[0], returned: JSON.stringify(page.simulate(again).ise) === JSON.stringify(run.ise),
      command: commandLine(page.data, settings), V: run.V[0], values: run.values});
  }
  const slider = document.getElementById("row-c1");
  slider.value = 900;
  slider.dispatchEvent(new Event("input"));
  page.update();
  page.rest();
  const unnamed = [...document.querySelectorAll("input, button, canvas")].filter((node) =>
    !(node.labels?.length || node.textContent.trim() || node.getAttribute("aria-label")));
  const pre = document.createElement("pre");
  pre.id = "found";
  pre.textContent = JSON.stringify({runs: found, hash: location.hash, unnamed: unnamed.length,
    c1: page.settings.values.c1, spoken: document.getElementById("spoken").textContent});
  document.body.append(pre);
})();
</script>
"""

# Alone: where the browser runs on virtual time, as for the probe, its clock stands still.
CLOCK = """
<script>
(async () => {
  while (document.documentElement.dataset.ready !== "yes") await new Promise((go) => setTimeout(go, 5));
  const page = window.explorer;
  for (let i = 0; i < 60; i += 1) { page.settings.values.c1 = 10 + i / 4; page.update(); }
  const [compute, frame] = [0, 1].map((k) => median(page.frames.map((one) => one[k])));
  console.log(`TIMES ${compute} ${frame} END`);
})();
</script>
"""


@dataclass(frozen=True)
class Shown:
    """The page of the paper's model, and what the probe found in it."""

    prepared: Prepared
    page: Page
    asked: list[dict[str, Any]]
    found: dict[str, Any]


def drawn(seed: int) -> list[dict[str, Any]]:
    """Settings as a reader might choose them: the first are the model's own, for each kind of saturation."""
    random_number = random.Random(seed)
    kinds = ("compensator", "clip", "braking")
    found: list[dict[str, Any]] = [{"saturation": kind} for kind in kinds]
    while len(found) < RUNS:
        values = {name: round(random_number.uniform(5, 25), 3) for name in ("c1", "c2")}
        values |= {name: round(random_number.uniform(0.5, 3), 3) for name in ("ck1", "ck2")}
        values |= {
            "u_max": round(random_number.uniform(4, 15), 2),
            "load": round(random_number.uniform(-1, 1), 2),
        }
        values |= {"reference_gain": round(random_number.uniform(0, 2), 2)}
        values |= {"reference_rate": round(random_number.uniform(0.2, 2), 2)}
        found.append(
            {
                "saturation": random_number.choice(kinds),
                "controller": "sampled" if len(found) % 3 == 0 else "continuous",
                "sample_time": random_number.choice([0.001, 0.002, 0.005]),
                "start": random_number.choice(["zero", "matched"]),
                "x0": [round(random_number.uniform(-2, 2), 3), round(random_number.uniform(-1, 1), 3)],
                "values": values,
                "factors": {"b0_plant": round(random_number.uniform(0.8, 1.2), 3)},
            }
        )
    return found


def in_browser(page: Page, asked: list[dict[str, Any]], folder: Path) -> dict[str, Any]:
    """Open the page from disk with the probe in it, and read what the probe leaves."""
    words = {"asked": json.dumps(asked), "columns": json.dumps(COLUMNS), "every": str(EVERY)}
    probe = PROBE
    for word, value in words.items():
        probe = probe.replace(f"@{word}@", value)
    file = folder / "page.html"
    file.write_text(page.html.replace("</body>", f"{probe}</body>"), encoding="utf-8")
    command = [str(BROWSER), *FLAGS, f"--user-data-dir={folder / 'profile'}", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    left = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert left is not None, done.stderr[-2000:]
    found: dict[str, Any] = json.loads(html.unescape(left[1]))
    return found


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    notes: list[str] = []
    prepared = prepare("paper", environment=os.environ, notify=notes.append)
    page = make_page(prepared, environment=os.environ, notify=notes.append)
    assert not notes
    asked = drawn(16)
    return Shown(prepared, page, asked, in_browser(page, asked, tmp_path_factory.mktemp("browser")))


def loops(shown: Shown) -> dict[str, ClosedLoop]:
    """The host's loops over the same document."""
    path = find_model("paper").absolute()
    return {
        kind: ClosedLoop(evaluator_of(Source(path, shown.prepared.knobbed.document, saturation=kind)))
        for kind in ("compensator", "clip", "braking")
    }


def test_its_runs_are_those_of_the_command_line(shown: Shown) -> None:
    """Every column of 20 runs, their switches and their figures."""
    host = loops(shown)
    worst = 0.0
    for change, found in zip(shown.asked, shown.found["runs"], strict=True):
        loop = host[change["saturation"]]
        values = dict(change.get("values", {}))
        for own, factor in change.get("factors", {}).items():
            values[own] = float(f"{factor * 2.0:.12g}")  # b0 = 2
        keywords = {key: change[key] for key in ("controller", "sample_time", "start", "x0") if key in change}
        run = loop.simulate(parameters=values, **keywords)
        assert found["status"] == 1
        for name in COLUMNS:
            expected = run[name][::EVERY]
            apart = np.abs(np.array(found["columns"][name]) - expected) / np.maximum(1.0, np.abs(expected))
            worst = max(worst, float(apart.max()))
            assert apart.max() <= TOLERANCE, (change, name)
        assert [label for _, label in found["switches"]] == [label for _, label in run.switches]
        assert found["ise"] == pytest.approx(run.ise, rel=TOLERANCE)
        assert found["peak"] == pytest.approx(run.peaks["v"][0], rel=TOLERANCE)
        assert found["saturated"] == pytest.approx(run.summary["saturated_s"], rel=TOLERANCE, abs=TOLERANCE)
    print(f"largest difference of {RUNS} runs: {worst:.2g}")


def test_its_model_is_the_file_s(shown: Shown) -> None:
    """With every knob at rest, the page's run is that of the model as it is in the file."""
    run = ClosedLoop.load("paper").simulate()
    found = shown.found["runs"][0]["columns"]
    for name in COLUMNS:
        np.testing.assert_allclose(found[name], run[name][::EVERY], rtol=TOLERANCE, atol=TOLERANCE)


def test_v_is_that_of_the_certificate(shown: Shown) -> None:
    """V(0) against (30) with P from a Kronecker system; at zero filters epsilon(0) = x0."""
    found, values = shown.found["runs"][0], shown.found["runs"][0]["values"]
    A0 = np.array([[-values["k1"], 1.0], [-values["k2"], 0.0]])
    system = np.kron(A0.T, np.eye(2)) + np.kron(np.eye(2), A0.T)
    P = np.linalg.solve(system, -2.0 * np.eye(2).reshape(-1)).reshape(2, 2)
    z = np.array([found["columns"][name][0] for name in ("z1", "z2")])
    epsilon = np.array([1.5, 0.0])
    weight = 1 / (2 * values["e1"]) + 1 / (2 * values["e2"])
    assert found["V"] == pytest.approx(float(z @ z / 2 + weight * epsilon @ P @ epsilon), rel=1e-12)


def test_a_link_carries_the_settings(shown: Shown) -> None:
    assert all(found["returned"] for found in shown.found["runs"])
    assert f"p.c1={shown.found['c1']}" in shown.found["hash"]


def test_the_command_names_what_was_set(shown: Shown) -> None:
    first, last = shown.found["runs"][0]["command"], shown.found["runs"][-1]["command"]
    assert first == "pmjoint simulate paper"
    for words in ("--set c1=", "--set b0_plant=", "--reference", "--disturbance", "--x0="):
        assert words in last


def test_every_control_has_a_name_and_changes_are_spoken(shown: Shown) -> None:
    assert shown.found["unnamed"] == 0
    assert "reached the horizon" in shown.found["spoken"]


def test_a_redraw_fits_a_frame(shown: Shown, tmp_path: Path) -> None:
    """A run of 20 s and six plots; the bound leaves room for a loaded machine, a frame is 16 ms."""
    file = tmp_path / "page.html"
    file.write_text(shown.page.html.replace("</body>", f"{CLOCK}</body>"), encoding="utf-8")
    flags = [flag for flag in FLAGS if not flag.startswith(("--virtual", "--dump"))]
    log = tmp_path / "log"
    command = [str(BROWSER), *flags, "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'profile'}"]
    with log.open("wb") as stream:
        child = subprocess.Popen([*command, file.as_uri()], stderr=stream, start_new_session=True)
        try:
            times = told(log)
        finally:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    compute, frame = times
    print(f"run {compute:.2f} ms, run and plots {frame:.2f} ms")
    assert 0 < compute < frame < 100


def told(log: Path) -> tuple[float, float]:
    """The times that the page writes to its console, ms."""
    for _ in range(600):
        found = re.search(r"TIMES (\S+) (\S+) END", log.read_text(errors="replace"))
        if found is not None:
            return float(found[1]), float(found[2])
        time.sleep(0.1)
    raise AssertionError(log.read_text(errors="replace")[-2000:])


def test_the_page_is_small_alone_and_the_same_each_time(shown: Shown) -> None:
    text = shown.page.html
    assert len(text.encode()) < 1_000_000
    assert re.search(r"""(src|href)=["'](?!data:)""", text) is None
    assert "fetch(" not in text and "import(" not in text
    again = make_page(shown.prepared, environment=os.environ, notify=print)
    assert again.html == text
