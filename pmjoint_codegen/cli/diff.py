"""``pmjoint diff``: what has changed in a model since a revision of git."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from pmjoint_codegen.cli.options import ModelName
from pmjoint_codegen.cli.terminal import activity, document, result, table

if TYPE_CHECKING:
    from pmjoint_codegen.emit.changes import Change
    from pmjoint_codegen.review.difference import Difference


_ABOUT = """Show what differs between MODEL in a revision of git and in the working tree.

Compares named equations, values of the model file, operations of the kernels, bytes of the generated files,
and figures of the golden trajectory. Each side is read from its generated folder. Where that folder does not
follow from the model file, the model is rederived, and the output says so. Nothing is checked out or written.
"""

_EXAMPLES = """\b
Examples
  pmjoint diff paper                    what is not committed yet
  pmjoint diff paper --rev main         what a branch changes
  pmjoint diff paper --rev HEAD~3 --json | jq .equations
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@click.option("--rev", "revision", default="HEAD", show_default=True, help="The revision to compare with.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(model: str, revision: str, as_json: bool) -> None:
    """Run ``pmjoint diff``: click passes the parsed arguments."""
    with activity(f"comparing {model}") as shown:
        shown.stage("loading the comparison", 0.0)
        from pmjoint_codegen.review.difference import difference

        found = difference(model, revision, shown.stage)
    if as_json:
        document(_record(found))
    else:
        result("\n".join(lines(found)))


def lines(found: Difference) -> Iterator[str]:
    """List all differences, a paragraph each for equations, values, generated code and golden figures."""
    names = dict.fromkeys((found.before.name, found.after.name))
    yield " -> ".join(names)
    yield f"  before  {found.before.source}"
    yield f"  after   {found.after.source}"
    yield from ("", _heading("equations", found.equations, len(found.after.content.equations)))
    yield from (f"  {line}" for change in found.equations for line in change.equation_lines())
    yield from ("", _heading("values", found.values, len(found.after.content.values)))
    yield from (f"  {item}" for item in found.values)
    yield from ("", "generated code")
    sizes = [(item, "bytes") for item in found.sizes] + [(item, "operations") for item in found.operations]
    yield table([_size_row(item, unit) for item, unit in sizes]) if sizes else "  of the same size"
    yield from ("", *_golden_lines(found))


def _heading(what: str, differing: Sequence[Change], total: int) -> str:
    return f"{what}: {len(differing)} of {total} differ" if differing else f"{what}: all {total} are the same"


def _text(value: object) -> str:
    return "none" if value is None else str(value)


def _size_row(item: Change, unit: str) -> tuple[str, ...]:
    whole = item.before is not None and item.after is not None and item.before > 0
    growth = round(100 * (item.after / item.before - 1), 1) or 0.0 if whole else 0.0  # no -0.0
    ratio = f"{growth:+.1f} %" if whole else ""
    after = "none" if item.after is None else f"{item.after} {unit}"
    return item.name, _text(item.before), "->", after, ratio


def _golden_lines(found: Difference) -> Iterator[str]:
    yield "golden trajectory"
    if found.before.trajectory is None or found.after.trajectory is None:
        yield f"  before  {found.before.golden_source}"
        yield f"  after   {found.after.golden_source}"
        return
    if found.figures:
        yield table([(item.name, *_figures(item)) for item in found.figures])
    if found.deviation is None:
        yield "  other columns or instants"
    elif found.deviation:
        yield f"  largest difference {found.deviation:.3g}, relative to max(1, |value|)"
    else:
        yield "  the same"


def _figures(item: Change) -> tuple[str, str, str]:
    """Print before and after with enough digits to distinguish them."""
    short = [
        f"{value:.6g}" if isinstance(value, float) else _text(value) for value in (item.before, item.after)
    ]
    before, after = short if short[0] != short[1] else (repr(item.before), repr(item.after))
    return before, "->", after


def _record(found: Difference) -> dict[str, object]:
    groups = ("equations", "values", "operations", "sizes")
    figures = [asdict(change) for change in found.figures]
    sources = {"before": found.before.golden_source, "after": found.after.golden_source}
    return {
        "model": found.after.name,
        "before": found.before.source,
        "after": found.after.source,
        **{key: [asdict(change) for change in getattr(found, key)] for key in groups},
        "golden": {**sources, "figures": figures, "deviation": found.deviation},
    }
