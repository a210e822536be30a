"""A browser without a window, which prints a page as PDF."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from pmjoint_codegen.errors import BuildError, MissingToolError

NAMES: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
QUIET: Final = (  # no window, and no request of the browser's own
    "--headless=new",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PRINTING: Final = ("--no-pdf-header-footer", "--generate-pdf-document-outline")
PATIENCE_S: Final = 120


def find_browser(environment: Mapping[str, str]) -> str:
    """The browser of this machine.

    Args:
        environment: its PATH is searched.

    Raises:
        MissingToolError: there is none.
    """
    found = next(filter(None, (shutil.which(name, path=environment.get("PATH")) for name in NAMES)), None)
    if found is None:
        raise MissingToolError(
            f"a PDF needs a browser ({', '.join(NAMES)})",
            remedy="install one: sudo apt install chromium; or open the HTML file and print it",
        )
    return found


def printed(html: str, browser: str) -> bytes:
    """Print a page.

    The creation date that the browser writes is set to a fixed one, so that equal pages give equal files.

    Args:
        html: the page.
        browser: its command.

    Raises:
        BuildError: the browser failed.
    """
    with tempfile.TemporaryDirectory(prefix="pmjoint-print-") as place:
        page, target = Path(place) / "report.html", Path(place) / "report.pdf"
        page.write_text(html, encoding="utf-8")
        # A browser of root refuses its own sandbox; the page is our own and has no script.
        safe = ["--no-sandbox"] if os.geteuid() == 0 else []
        where = [f"--user-data-dir={place}/profile", f"--print-to-pdf={target}", page.as_uri()]
        try:
            done = subprocess.run(
                [browser, *QUIET, *PRINTING, *safe, *where],
                capture_output=True,
                timeout=PATIENCE_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise BuildError(f"the browser did not print within {PATIENCE_S} s", where=browser) from None
        if not target.is_file():
            said = done.stderr.decode(errors="replace")
            raise BuildError("the browser printed nothing", where=browser, output=said)
        return undated(target.read_bytes())


def undated(data: bytes) -> bytes:
    """A PDF file with its dates set to the epoch; the length, on which its index depends, stays the same."""
    import re

    epoch = b"D:19700101000000+00'00'"
    return re.sub(rb"\(D:\d{14}[^)]*\)", lambda found: b"(" + epoch[: len(found[0]) - 2] + b")", data)
