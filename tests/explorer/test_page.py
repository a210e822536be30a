"""The file itself: alone, small, the same each time; and its pace."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.explorer import measure
from pmjoint_codegen.cli.explorer import command
from pmjoint_codegen.errors import MissingToolError
from pmjoint_codegen.explorer.page import make_page

from .conftest import Shown
from .devtools import Browser

BYTES = 1_000_000


def test_the_page_is_small_alone_and_the_same_each_time(paper: Shown) -> None:
    text = paper.page.html
    assert len(text.encode()) < BYTES
    assert re.search(r"""(src|href)=["'](?!data:)""", text) is None
    assert "fetch(" not in text
    assert "import(" not in text
    again = make_page(paper.prepared, environment=os.environ, notify=print)
    assert again.html == text


def test_the_first_plots_come_soon_and_a_redraw_fits_a_frame(browser: Browser, paper: Shown) -> None:
    """Bounds that a loaded machine keeps; ``python -m benchmarks.explorer`` prints figures."""
    pace = measure(browser, paper.file)
    print(pace)
    assert pace.first < 3000
    assert 0 < pace.run < pace.redraw < 50


@pytest.mark.usefixtures("no_ziglang")
def test_without_ziglang_it_names_the_line_that_installs_it(tmp_path: Path) -> None:
    done = CliRunner().invoke(command, ["--out", str(tmp_path / "page.html")], standalone_mode=False)
    assert isinstance(done.exception, MissingToolError)
    assert "pmjoint-codegen[compiler]" in str(done.exception)
    assert not (tmp_path / "page.html").exists()
