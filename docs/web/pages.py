"""What the site holds beside docs/: linked sources, derivations, the reference, the explorer."""

from __future__ import annotations

import importlib
import os
import posixpath
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
DOCS: Final = "docs/"
# Pages of the repository outside docs/ -> their addresses in the site.
OUTSIDE: Final = {"CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
DERIVATIONS: Final = "derivations"
REFERENCE: Final = "reference"
EXPLORER: Final = "live/paper.html"
REPORT: Final = "live/paper-report.html"

_PACKAGE: Final = "pmjoint_codegen"
_LEXERS: Final = {".toml": "toml", ".py": "python", ".yml": "yaml", ".c": "c", ".h": "c"}
_PICTURES: Final = (".png", ".svg")


@dataclass(frozen=True)
class _Chapter:
    """A page of the reference.

    Attributes:
        title: its heading.
        homes: modules whose public names it documents, those that `pmjoint_codegen` exports.
        further: full names of what else it documents, after these.
    """

    title: str
    homes: tuple[str, ...]
    further: tuple[str, ...] = ()


_CHAPTERS: Final[Mapping[str, _Chapter]] = {
    "closed-loop": _Chapter("Closed loop", ("closed_loop",)),
    "run": _Chapter("Run", ("simulate",), ("simulate.record.Record",)),
    "controller": _Chapter(
        "Controller",
        ("controller",),
        ("controller.Controller", "controller.ControllerState", "kernels.law.Law"),
    ),
    "control-systems": _Chapter(
        "Control systems and margins", ("systems", "margins"), ("systems.ControlSystems", "margins.Margins")
    ),
    "sweep": _Chapter(
        "Sweep",
        ("sweep", "studies.sweep"),
        ("sweep.plan.Plan", "sweep.plan.Axis", "sweep.plan.Sample", "sweep.dataset.read"),
    ),
    "tune": _Chapter("Tune", ("tune", "studies.tune"), ("tune.objective.Objective", "tune.search.Found")),
    "export": _Chapter("Export", ("export",), ("export.package.Export", "export.package.export_c")),
    "errors": _Chapter("Errors", ("errors",)),
    "more": _Chapter("More public names", ("",)),
}


def address(path: str) -> str | None:
    """Path under docs/ at which the site holds a file of the repository, or None if it is a page of none.

    A page stays where it is; a picture too. Any other file becomes a page that shows it.
    """
    if path in OUTSIDE:
        return OUTSIDE[path]
    derivation = re.fullmatch(r"generated/([\w-]+)/derivation\.md", path)
    if derivation is not None:
        return f"{DERIVATIONS}/{derivation[1]}.md"
    steps = re.fullmatch(r"docs/notebooks/([\w-]+)\.py", path)
    if steps is not None:  # it is shown as executed
        return f"notebooks/{steps[1]}.md"
    inside = path.removeprefix(DOCS)
    if posixpath.splitext(path)[1] in (".md", *_PICTURES):
        return inside if inside != path else None
    return f"{inside}.md"


def outside_pages() -> Iterator[tuple[str, str]]:
    """Paths and texts of the pages that lie outside docs/: changes, contributing, derivations."""
    derivations = sorted(ROOT.glob("generated/*/derivation.md"))
    for file in (*map(ROOT.joinpath, OUTSIDE), *derivations):
        yield file.relative_to(ROOT).as_posix(), file.read_text(encoding="utf-8")


def source_page(path: str) -> str:
    """Show a file that some page links."""
    text = (ROOT / path).read_text(encoding="utf-8")
    lexer = _LEXERS.get(posixpath.splitext(path)[1], "text")
    return f"# {posixpath.basename(path)}\n\n`{path}`\n\n````{lexer}\n{text.rstrip()}\n````\n"


def reference_pages() -> Iterator[tuple[str, str]]:
    """Names and texts of the reference: directives for mkdocstrings, which reads the docstrings."""
    left = list(public_names())
    for page, chapter in _CHAPTERS.items():
        public = [name for name in left if any(f"{name}.".startswith(_full(home)) for home in chapter.homes)]
        left = [name for name in left if name not in public]
        shown = dict.fromkeys([*public, *map(_full, chapter.further)])
        if shown:
            yield (
                f"{REFERENCE}/{page}.md",
                f"# {chapter.title}\n\n" + "\n".join(f"::: {name}\n" for name in shown),
            )


def public_names() -> Iterator[str]:
    """Full names of what ``pmjoint_codegen`` exports, each by the module that defines it."""
    package = importlib.import_module(_PACKAGE)
    for name in package.__all__:
        value = getattr(package, name)
        if isinstance(value, ModuleType):  # a package that can be called: by the function of its name
            value = getattr(importlib.import_module(f"{_PACKAGE}.studies.{name}"), name)
        if hasattr(value, "__qualname__"):
            yield f"{value.__module__}.{value.__qualname__}"


def _full(name: str) -> str:
    return f"{_PACKAGE}.{name}"


def explorer() -> str:
    """Make the page of `pmjoint explorer paper`."""
    return _written("explorer", "paper")


def report() -> str:
    """Make the page of `pmjoint report paper`."""
    return _written("report", "paper")


def _written(*command: str) -> str:
    """Run a command that writes one page, and return the page.

    Raises:
        RuntimeError: it failed; its message stands on standard error.
    """
    from pmjoint_codegen.cli.main import run

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "page.html"
        with redirect_stdout(StringIO()):
            code = run([*command, "--out", os.fspath(file)])
        if code:
            raise RuntimeError(f"pmjoint {' '.join(command)}: exit code {code}")
        return file.read_text(encoding="utf-8")
