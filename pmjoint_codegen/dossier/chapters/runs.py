"""The default run, the region of recovery, and the margins."""

from __future__ import annotations

import math
import re

from pmjoint_codegen.dossier.facts import Absent, Facts, Pace
from pmjoint_codegen.dossier.markup import (
    absent,
    chapter,
    code,
    number,
    paragraph,
    picture,
    plain,
    prose,
    table,
    tag,
)
from pmjoint_codegen.simulate.estimates import FrozenError, estimate_columns
from pmjoint_codegen.simulate.figures import draw, look_of
from pmjoint_codegen.simulate.page import PRINTED
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.sheets import caption, sheets
from pmjoint_codegen.simulate.style import rendered

PLAIN = PRINTED.__class__(PRINTED.width, PRINTED.scale, caption=False)
SHOWN = {
    "status": ("ended", ""),
    "saturated_s": ("u at a limit", "s"),
    "settling_s": ("within 2 % of the initial error after", "s"),
    "ise": ("integral of e² (ISE)", "{y}² s"),
    "max_abs_e": ("largest |e|", "{y}"),
    "final_e": ("e at the end", "{y}"),
    "max_abs_v": ("largest |v|", "{u}"),
    "disturbance_max": ("largest |D|", ""),
    "steps": ("steps of the integration", ""),
}


def run_chapter(facts: Facts) -> str:
    """The run's summary and its figures."""
    if isinstance(facts.run, Absent):
        return chapter("run", "Default run", absent(facts.run.reason))
    settings = facts.run.settings
    words = (
        f"From x(0) = ({', '.join(number(float(value)) for value in settings.x0)}) to "
        f"{number(settings.horizon)} s with the reference {code(facts.run.reference_text)}. "
        f"The same run: {code(f'pmjoint simulate {facts.called}')}."
    )
    figures = [
        picture(
            rendered(draw(facts.run, sheet, detail=facts.transient, page=PLAIN), look_of(PLAIN), "svg"),
            alt_text(sheet.stem, facts.run),
            prose(words_of(caption(facts.run, sheet, ()))),
        )
        for sheet in sheets(facts.run, None if isinstance(facts.frozen, Absent) else facts.frozen)
    ]
    return chapter(
        "run",
        "Default run",
        paragraph(words),
        summary_table([("value", facts.run)]),
        _estimates(facts.run),
        _uncompared(facts.frozen),
        *figures,
    )


def _uncompared(frozen: FrozenError | Absent | None) -> str:
    """Why figures show no error without adaptation, if that run failed."""
    if not isinstance(frozen, Absent):
        return ""
    return paragraph("The figures show no error without adaptation: ", plain(frozen.reason), ".")


def _estimates(run: Run) -> str:
    """Where estimates began and ended, beside the plant's own values; nothing without them."""
    found = run.summary.get("estimates")
    if found is None:
        return ""
    units = {item.name: item.unit for item in estimate_columns(run.manifest)}
    rows = [
        (
            code(name),
            _value(item["first"]),
            _value(item["final"]),
            f"{code(item['of'])} = {_value(item['true'])}",
            "none" if item["range"] is None else " to ".join(map(_value, item["range"])),
            plain(units[name]),
        )
        for name, item in found.items()
    ]
    words = "An estimate need not reach the plant’s own value; it is no identified parameter."
    if "V" in run.summary:
        V = run.summary["V"]
        words += f" V goes from {_value(V['first'])} to {_value(V['final'])}."
    head = ("estimate", "at the start", "at the end", "the plant’s own", "range", "unit")
    return table(head, rows, caption="Estimates", right=(1, 2)) + paragraph(words)


def _value(value: float | None) -> str:
    return "none" if value is None else number(value)


def summary_table(runs: list[tuple[str, Run | Absent]]) -> str:
    """Summaries of runs side by side.

    Args:
        runs: heading of each column, and its run.
    """
    present = [run for _, run in runs if not isinstance(run, Absent)]
    rows = []
    for key, (words, written) in SHOWN.items():
        if not any(key in run.summary for run in present):
            continue
        cells = [_cell(run, key, written) for _, run in runs]
        rows.append((plain(words), *cells))
    head = ("quantity", *(name for name, _ in runs))
    return table(head, rows, caption="Summary of the run", right=tuple(range(1, len(head))))


def _cell(run: Run | Absent, key: str, written: str) -> str:
    if isinstance(run, Absent):
        return "no run"
    value = run.summary.get(key)
    if isinstance(value, str):
        return plain(value)
    if value is None:
        return "none"
    units = {item.name: item.unit for item in run.manifest.signals}
    of = written.format(y=units.get("y", ""), u=units.get("u", ""))
    return f"{number(float(value))} {plain(of)}".rstrip()


def alt_text(stem: str, run: Run) -> str:
    """A figure in words, for readers who do not see it."""
    name = stem.partition("_")[2].replace("_", " ")
    e, end = run.summary["max_abs_e"], float(run.t[-1])
    return (
        f"{name} over time from 0 to {end:g} s; the tracking error is at most {e:.4g} and ends at "
        f"{run.summary['final_e']:.3g}; the input is at a limit for {run.summary['saturated_s']:.4g} s"
    )


def words_of(text: str) -> str:
    """A caption without the markup of its mathematics."""
    text = re.sub(r"\\(?:mathrm|mathit|dot|hat|tilde)\{([^{}]*)\}", r"\1", text)
    text = re.sub(r"\\(?:var)?(max|min|theta|alpha|lambda|rho|chi|sin|cos)\b", r"\1", text)
    return re.sub(r"[${}]|\\[ ,;]|\\", "", text.replace("_{", "_"))


def region_chapter(facts: Facts) -> str:
    """The map of recovery."""
    region = facts.region
    if isinstance(region, Absent):
        return chapter("region", "Region of recovery", absent(region.reason))
    share = 100 * region.held / region.runs
    words = (
        f"{region.held} of {region.runs} runs ({number(share, 4)} %) from a grid of initial states keep the "
        f"output bounded up to the horizon. The same grid: {code(region.command)}."
    )
    drawn, legend = (
        ("map of settling times over a grid of", "Colour: settling time. Grey: the output diverges.")
        if region.plane
        else ("curves of four figures over a row of", "A curve has a gap where the output diverges.")
    )
    alt = f"{drawn} initial states; {share:.1f} % of the runs stay bounded"
    note = f"{legend} A run that stays bounded up to the horizon is no proof beyond it; {region.words}."
    return chapter(
        "region", "Region of recovery", paragraph(words), picture(region.svg, alt, plain(note), kind="narrow")
    )


def margins_chapter(facts: Facts) -> str:
    """Margins at the plant's input, and what a clock does."""
    return chapter(
        "margins",
        "Margins and sampling",
        tag("h3", "At the plant’s input", id="margins-input"),
        margins_table([("value", facts)]),
        tag("h3", "The sampled controller", id="sampled"),
        _sampled(facts),
    )


def margins_table(columns: list[tuple[str, Facts]]) -> str:
    """Margins of models side by side; reasons where there are none."""
    found = [(name, facts.margins) for name, facts in columns]
    rows = [
        (words, *("none" if isinstance(m, Absent) else f"{number(getattr(m, key), 4)}{of}" for _, m in found))
        for words, key, of in (
            ("gain margin, upwards", "gain_margin", ""),
            ("gain margin, downwards", "lower_gain_margin", ""),
            ("phase margin", "phase_margin", "°"),
            ("delay margin", "delay_margin", " s"),
            ("constant reference", "y_r", ""),
            ("input there", "u", ""),
        )
    ]
    reasons = "".join(absent(m.reason) for _, m in found if isinstance(m, Absent))
    if all(isinstance(m, Absent) for _, m in found):
        return reasons
    words = (
        "The loop is cut at the plant’s input and linearised about the equilibrium for the reference at "
        "t = 0, with no limit active. A gain margin of ∞ or 0 means that no factor up or down makes "
        "the loop oscillate."
    )
    head = ("margin", *(name for name, _ in found))
    return paragraph(words) + table(head, rows, right=tuple(range(1, len(head)))) + reasons


def _longest(pace: Pace) -> float:
    """The sample time at which the law is as fast as the limit allows, s."""
    return pace.sample_time * pace.limit / pace.turn if pace.turn else math.inf


def _sampled(facts: Facts) -> str:
    pace = facts.pace
    fits = "is below" if pace.turn <= pace.limit else "exceeds"
    words = (
        f"At the model’s sample time of {number(pace.sample_time)} s the fastest rate of the law times the "
        f"sample time is {number(pace.turn, 3)}. It {fits} {number(pace.limit)}, above which the loop may be "
        f"unstable; a sample time of {number(_longest(pace), 3)} s reaches it."
    )
    return paragraph(words) + summary_table([("continuous", facts.run), ("sampled", facts.sampled)])
