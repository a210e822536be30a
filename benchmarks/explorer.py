"""Pages of `pmjoint explorer`: their size, the time to the first plots, and how they follow a slider.

    python -m benchmarks.explorer                        # every shipped model
    python -m benchmarks.explorer paper models/gallery/maglev.toml

Each page is opened from disk in headless Chromium, in a tab of its own. *First* is the time from the start of
the navigation to the first plots. *Run* and *redraw* are medians over 120 positions of a slider, one in each
frame: the run alone, and the run with its plots and numbers. *Frames* is how many of them were shown in a
second. The browser asks for 60; without a graphics card it draws them on the processor, too.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks.reference import ROOT
from pmjoint_codegen.explorer.page import make_page, prepare
from tests.explorer.devtools import Browser, running

DRAG = """
(async () => {
  const frame = () => new Promise((go) => requestAnimationFrame(go));
  const page = window.explorer;
  const slider = document.getElementById("row-c1");
  const times = [];
  const begun = performance.now();
  for (let i = 0; i < 120; i += 1) {
    slider.value = 440 + i;
    slider.dispatchEvent(new Event("input"));
    await frame();
    times.push(page.frames.at(-1));
  }
  const rate = 120000 / (performance.now() - begun);
  return [page.first, median(times.map(([run]) => run)), median(times.map(([, whole]) => whole)), rate];
})()
"""


@dataclass(frozen=True)
class Pace:
    """What was measured of a page: times in ms, frames in 1/s."""

    first: float
    run: float
    redraw: float
    frames: float


def measure(browser: Browser, file: Path) -> Pace:
    """Open a page and drag its first gain."""
    tab = browser.open(file.as_uri(), width=1280, height=900)
    pace = Pace(*tab.evaluate(DRAG))
    tab.close()
    return pace


def main(models: list[str]) -> int:
    """Print one line a model; 1 where a page is above 1 MB or its first plots come after a second."""
    shipped = [*(ROOT / "models").glob("*.toml"), *(ROOT / "models" / "gallery").glob("*.toml")]
    chosen = models or sorted(str(path.relative_to(ROOT)) for path in shipped)
    missed = False
    print(f"{'model':18} {'bytes':>8} {'first ms':>9} {'run ms':>7} {'redraw ms':>9} {'frames/s':>8}")
    with (
        tempfile.TemporaryDirectory() as name,
        running(shutil.which("chromium") or "chromium", Path(name)) as browser,
    ):
        for model in chosen:
            prepared = prepare(model, environment=os.environ, notify=print)
            page = make_page(prepared, environment=os.environ, notify=print)
            file = Path(name) / "page.html"
            file.write_text(page.html, encoding="utf-8")
            pace, size = measure(browser, file), file.stat().st_size
            times = f"{pace.first:9.0f} {pace.run:7.1f} {pace.redraw:9.1f} {pace.frames:8.0f}"
            print(f"{Path(model).stem:18} {size:8d} {times}", flush=True)
            missed = missed or size > 1e6 or pace.first > 1000
    return int(missed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
