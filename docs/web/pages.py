"""What the site holds beside docs/: linked sources, derivations, the reference, the explorer."""

from __future__ import annotations

import importlib
import os
import posixpath
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
DOCS: Final = "docs/"
# Pages of the repository outside docs/ -> their addresses in the site.
OUTSIDE: Final = {"CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
DERIVATIONS: Final = "derivations"
REFERENCE: Final = "reference"
EXPLORER: Final = "live/paper.html"
REPORT: Final = "live/paper-report.html"

_LEXERS: Final = {".toml": "toml", ".py": "python", ".yml": "yaml", ".c": "c", ".h": "c"}
_PICTURES: Final = (".png", ".svg")

# Page of the reference -> title and what it documents. The rest of the package's public names joins the last.
_DOCUMENTED: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "closed-loop": ("Closed loop", ("pmjoint_codegen.closed_loop.ClosedLoop",)),
    "run": ("Run", ("pmjoint_codegen.simulate.run.Run", "pmjoint_codegen.simulate.record.Record")),
    "controller": (
        "Controller",
        (
            "pmjoint_codegen.controller.Controller",
            "pmjoint_codegen.controller.ControllerState",
            "pmjoint_codegen.kernels.law.Law",
        ),
    ),
    "control-systems": (
        "Control systems and margins",
        ("pmjoint_codegen.systems.ControlSystems", "pmjoint_codegen.margins.Margins"),
    ),
    "sweep": (
        "Sweep",
        (
            "pmjoint_codegen.sweep.plan.Axis",
            "pmjoint_codegen.sweep.plan.Sample",
            "pmjoint_codegen.sweep.plan.Plan",
            "pmjoint_codegen.sweep.plan.make_plan",
            "pmjoint_codegen.sweep.dataset.read",
        ),
    ),
    "tune": (
        "Tune",
        (
            "pmjoint_codegen.tune.request.make_request",
            "pmjoint_codegen.tune.objective.Objective",
            "pmjoint_codegen.tune.search.search",
            "pmjoint_codegen.tune.search.Found",
        ),
    ),
    "export": (
        "Export",
        ("pmjoint_codegen.export.package.Export", "pmjoint_codegen.export.package.export_c"),
    ),
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
    shown: list[str] = []
    for name, (title, documented) in _DOCUMENTED.items():
        shown += documented
        yield f"{REFERENCE}/{name}.md", _reference(title, documented)
    errors, others = [], []
    for home in public_names():
        if home.startswith("pmjoint_codegen.errors."):
            errors.append(home)
        elif home not in shown:
            others.append(home)
    yield f"{REFERENCE}/errors.md", _reference("Errors", errors)
    if others:
        yield f"{REFERENCE}/more.md", _reference("More public names", others)


def _reference(title: str, names: Iterable[str]) -> str:
    return f"# {title}\n\n" + "\n".join(f"::: {name}\n" for name in names)


def public_names() -> Iterator[str]:
    """Full names of what ``pmjoint_codegen`` exports, each by the module that defines it."""
    package = importlib.import_module("pmjoint_codegen")
    for name in package.__all__:
        value = getattr(package, name)
        if hasattr(value, "__qualname__"):
            yield f"{value.__module__}.{value.__qualname__}"


def explorer() -> str:
    """Make the page of `pmjoint explorer paper`."""
    return _written("explorer", "paper")


def report() -> str | None:
    """Make the page of `pmjoint report paper`, where there is such a command."""
    from pmjoint_codegen.cli.commands import COMMANDS

    return _written("report", "paper") if any(entry.name == "report" for entry in COMMANDS) else None


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
