"""One browser, and the pages under test: three shipped models, and one with the whole chain and with data."""

from __future__ import annotations

import fcntl
import importlib.util
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.explorer.page import Page, Prepared, make_page, prepare
from pmjoint_codegen.workspace import find_model

from .devtools import Browser, Tab, running

CHROMIUM = shutil.which("chromium")
REFERENCE = "{ steps = [[0, 0.5], [2, 1.2], [6, -0.4]], filter = 3 }"
CHAINED = """
[sensor]
resolution = 0.0004
noise = 0.0002
seed = 7
filter = 300
"""  # added to the paper's model, with the keys of its actuator


@dataclass(frozen=True)
class Shown:
    """A page on disk.

    Attributes:
        model: as the command line takes it.
        prepared: what the page was made of.
        page: the page.
        file: where it is.
    """

    model: str
    prepared: Prepared
    page: Page
    file: Path

    @property
    def address(self) -> str:
        return self.file.as_uri()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs a browser or zig where there is none."""
    here = Path(__file__).parent
    reasons = {
        "chromium is not installed": CHROMIUM is None,
        "ziglang is not installed": importlib.util.find_spec("ziglang") is None,
    }
    for item in items:
        if here in item.path.parents:
            for reason, absent in reasons.items():
                item.add_marker(pytest.mark.skipif(absent, reason=reason))


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with running(str(CHROMIUM), tmp_path_factory.mktemp("chromium")) as started:
        yield started


def shown(model: str, folder: Path, *, only: str | None = None) -> Shown:
    """A model's page; `only` one kind of saturation besides plain clipping, which is sooner compiled."""
    notes: list[str] = []
    # One worker compiles, the other then finds it in the cache.
    with (Path(os.environ["PMJOINT_CACHE"]) / "explorer.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        prepared = prepare(model, environment=os.environ, notify=notes.append)
        if only is not None:
            prepared = replace(prepared, variants={only: prepared.variants[only]})
        page = make_page(prepared, environment=os.environ, notify=notes.append)
    assert not notes
    file = folder / f"{prepared.title}.html"
    file.write_text(page.html, encoding="utf-8")
    return Shown(model, prepared, page, file)


@pytest.fixture(scope="session")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    return shown("paper", tmp_path_factory.mktemp("paper"))


@pytest.fixture(scope="session")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Relative degree 3, and a plant with more states than the design."""
    return shown("joint-lag", tmp_path_factory.mktemp("lag"))


@pytest.fixture(scope="session")
def chained(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """The paper's plant with a sensor, a clock, a slow actuator, and steps to follow."""
    folder = tmp_path_factory.mktemp("chained")
    text = find_model("paper").read_text(encoding="utf-8")
    for given, wanted in (
        ('name   = "paper"', 'name   = "chained"'),
        ('limit = "u_max"', 'limit = "u_max"\nrate = 400\ndead_zone = 0.02\ndelay = 0.0013'),
        ('reference   = "sin(t)"', f"reference = {REFERENCE}"),
        ("horizon     = 20.0", "horizon = 8.0\ndelay_samples = 1\njitter = 0.0004"),
        ("[design]", f"{CHAINED}\n[design]"),
    ):
        assert text.count(given) == 1, given
        text = text.replace(given, wanted)
    (folder / "chained.toml").write_text(text, encoding="utf-8")
    return shown(str(folder / "chained.toml"), folder, only="compensator")


@pytest.fixture(scope="session")
def adaptive(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """A controller with estimates."""
    return shown("paper-adaptive", tmp_path_factory.mktemp("adaptive"))


def opened(browser: Browser, address: str, **screen: Any) -> Tab:
    """A tab of a page, with the functions of ``probes.js``."""
    tab = browser.open(address, **screen)
    tab.evaluate((Path(__file__).parent / "probes.js").read_text(encoding="utf-8"))
    return tab


@pytest.fixture
def tab(browser: Browser, paper: Shown) -> Iterator[Tab]:
    """The paper's page on a desk."""
    found = opened(browser, paper.address, width=1280, height=900)
    yield found
    found.close()
