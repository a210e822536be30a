"""A run in a console and in a notebook: what it was, how it ended, its key figures."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING, Final

from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.summary import held, saturated_time, saturation_of

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

_LEFT: Final = 'style="text-align:left"'
_DPI: Final = 110  # of a picture in a notebook, which a screen shows
_LABEL: Final = 10  # characters of a label in a console


def facts(run: Record) -> Iterator[tuple[str, str]]:
    """Label and text of each line that describes a run."""
    settings, units = run.settings, {item.name: item.unit for item in run.manifest.signals}
    clock = f" every {settings.sample_time:g} s" if settings.controller == "sampled" else ""
    kind = f"{settings.controller} controller{clock}, {saturation_of(settings.parameters)}"
    yield "run", f"{kind}, y_r = {_short(run.reference_text)}, {settings.horizon:g} s"
    yield "status", run.message if held(run) or run.status != Status.DONE else f"{run.message}; diverging"
    peak, peak_v, e, v = run.peaks["e"][0], run.peaks["v"][0], units["e"], units["v"]
    size = f"ISE {run.ise:.6g} {e}^2 s, max |e| {peak:.6g} {e}, max |v| {peak_v:.6g} {v}"
    yield "figures", f"{size}, settling {_settling(run)}, at a limit {saturated_time(run):.6g} s"
    yield "data", f"{len(run.t)} rows of {len(run.columns)} columns: {_short(', '.join(run.columns))}"


def _settling(run: Record) -> str:
    settled = run.settling_s
    return "not reached" if settled is None else f"{settled:.6g} s"


def _short(text: str, most: int = 60) -> str:
    return text if len(text) <= most else f"{text[: most - 4].rstrip(', ')} ..."


def text(run: Record) -> str:
    """A run in five lines."""
    lines = "\n".join(f"  {label.ljust(_LABEL)}{said}" for label, said in facts(run))
    return f"<{type(run).__name__} of {run.manifest.name}: {_short(run.manifest.title)}\n{lines}>"


def html(run: Record) -> str:
    """A run in a notebook: the lines of `text` as a table, and its overview if it can be drawn."""
    rows = "".join(
        f"<tr><th {_LEFT}>{escape(label)}</th><td {_LEFT}>{escape(said)}</td></tr>"
        for label, said in facts(run)
    )
    title = f"<b>{escape(run.manifest.name)}</b>: {escape(run.manifest.title)}"
    return f"<div>{title}<table>{rows}</table>{_picture(run)}</div>"


def _picture(run: Record) -> str:
    """The overview as a picture inside the page; nothing without Matplotlib, or of a run without rows."""
    try:
        import matplotlib  # noqa: F401 - it may be absent
    except ModuleNotFoundError:
        return ""
    if len(run.t) < 2:
        return ""
    from pmjoint_codegen.simulate.figures import look_of, overview
    from pmjoint_codegen.simulate.page import PRINTED
    from pmjoint_codegen.simulate.style import styled

    stream = BytesIO()
    with styled(look_of(PRINTED)):
        overview(run).savefig(stream, format="png", dpi=_DPI, facecolor="white")
    data = base64.b64encode(stream.getvalue()).decode("ascii")
    return f'<img alt="overview of the run" style="max-width:100%" src="data:image/png;base64,{data}">'
