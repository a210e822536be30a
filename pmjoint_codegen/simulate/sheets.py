"""The contents of a run's figures: curves, panels, captions, for any order; nothing is drawn here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.adaptive_panels import (
    adaptation_caption,
    error_caption,
    error_panels,
    estimate_panels,
    lyapunov_panel,
)
from pmjoint_codegen.simulate.assumptions import sentence
from pmjoint_codegen.simulate.blocks import compensator_states
from pmjoint_codegen.simulate.disturbance import disturbance_names, pressures
from pmjoint_codegen.simulate.estimates import is_adaptive
from pmjoint_codegen.simulate.panels import COLOURS, Line, Panel, by_unit, family, single, unit_text
from pmjoint_codegen.simulate.record import COMMAND, RATE
from pmjoint_codegen.simulate.style import BLUE, GREY, RED
from pmjoint_codegen.simulate.symbols import symbol

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.estimates import FrozenError
    from pmjoint_codegen.simulate.record import Record

PASCALS_IN_BAR = 1e5
_BOUNDS = {-1: "lower limit", 1: "upper limit"}
_LIMITS = {-1: "$-u_{\\max}$", 1: "$u_{\\max}$"}


@dataclass(frozen=True)
class Sheet:
    """One figure: panels from top to bottom and their caption.

    Attributes:
        stem: file name without ending.
        panels: from top to bottom.
        caption: one or two sentences.
        compensator: whether it shows a state of the compensator.
    """

    stem: str
    panels: tuple[Panel, ...]
    caption: str
    compensator: bool = False


def sheets(run: Record, frozen: FrozenError | None = None) -> tuple[Sheet, ...]:
    """Plan the figures of a run: tracking, the states from x2, the compensator, v and u, the estimate.

    Args:
        run: what to show.
        frozen: the error of the same run without adaptation, to draw beside that of an adaptive controller.
    """
    manifest, compensator = run.manifest, compensator_states(run.manifest)
    parts = "$e = y - y_r$"
    if compensator:
        first = compensator[0]
        parts = (
            f"$e = y - y_r = z_1 + {bare(first)}$ and its two parts"
            if run[first].any()
            else "$e = y - y_r = z_1$"
        )
    tracking = f"Tracking: output $y$ and reference $y_r$; error {parts}."
    plans: list[tuple[str, tuple[Panel, ...], str]] = [
        ("tracking_error", (output_panel(run), error_panel(run)), tracking)
    ]
    for i in range(2, manifest.n + 1):
        plans.append((f"x{i}", *_state(run, i)))
    for i, name in enumerate(compensator, start=1):
        which = "last state, driven by $u - v$" if i == manifest.rho else f"state {i}"
        panel = single(manifest, name, symbol(name))
        plans.append((name, (panel,), f"Saturation compensator (23), {which}."))
    law = "Control law $v$ and applied input $u = \\mathrm{sat}(v)$" + _saturation_text(run)
    plans.append(("v_u", _input_panels(run), law))
    estimate = "States, their estimates $\\hat{x}$ (15), and what the estimates miss."
    plans.append(("estimate", (*_estimate_panels(manifest), *miss_panels(manifest)), estimate))
    if pressures(run):
        plans.append(("pressures", _pressure_panels(run), _pressure_text(run)))
    if is_adaptive(manifest):
        plans.append(("adaptation", (*estimate_panels(run), *lyapunov_panel(run)), adaptation_caption(run)))
        plans.append(("adaptive_error", error_panels(run, frozen), error_caption(run, frozen)))
    made = (
        Sheet(f"figure{k}_{stem}", panels, text, stem in compensator)
        for k, (stem, panels, text) in enumerate(plans, start=1)
    )
    return tuple(
        sheet for sheet in made if not (sheet.compensator and all(p.is_zero(run) for p in sheet.panels))
    )


def overview_panels(run: Record) -> tuple[Panel, ...]:
    """Choose panels that show a whole run: output, error, states, compensator, input, estimate."""
    manifest = run.manifest
    both = (Line("v", "$v$", BLUE), Line("u", "$u$"))
    v_u = Panel(both, "$v,\\ u$" + unit_text(manifest, "u"), input_clip(run), _limits(run))
    first = min(2, manifest.n)
    names = [f"x{i}" for i in range(first, manifest.n + 1)]
    states = (_rate(manifest),) if pressures(run) else family(manifest, names, "x")
    driven = compensator_states(manifest)
    stem = bare(driven[0]).partition("_")[0] if driven else ""
    r = (panel for panel in family(manifest, driven, stem) if not panel.is_zero(run))
    adaptive = (*estimate_panels(run), *lyapunov_panel(run))
    return output_panel(run), error_panel(run), *states, *r, v_u, *miss_panels(manifest), *adaptive


def caption(run: Record, sheet: Sheet, notes: Sequence[str]) -> str:
    """Compose a figure's caption with its number and the run's settings."""
    number = sheet.stem.partition("_")[0].removeprefix("figure")
    left = " Left: the saturated transient." if transient_window(run) else ""
    shaded = " Shaded: $u$ at its limit." if saturated_intervals(run) else ""
    return f"Figure {number}. {sheet.caption}{left}{shaded} {_settings_caption(run, notes)}"


def overview_caption(run: Record, notes: Sequence[str]) -> str:
    """Compose the overview's caption: the model's title and the run's settings."""
    return f"{plain(run.manifest.title)}. {_settings_caption(run, notes)}"


def saturated_intervals(run: Record) -> tuple[tuple[float, float, int], ...]:
    """List the intervals (from, to, mode), in s, in which u is at a limit: mode -1 below, 1 above."""
    marks = [(0.0, run.initial_mode), *run.switches]
    ends = [*(t for t, _ in run.switches), float(run.t[-1])]
    spans = zip(marks, ends, strict=True)
    return tuple((start, stop, mode) for (start, mode), stop in spans if mode and stop > start)


def transient_window(run: Record) -> float | None:
    """Return the end of the saturated transient's panel, s; None if it needs no separate panel."""
    intervals = saturated_intervals(run)
    window = 2.0 * intervals[-1][1] if intervals else 0.0
    return window if 0.0 < window < 0.3 * float(run.t[-1]) else None


def limit_name(run: Record, mode: int) -> str:
    """Name the limit of a saturated mode."""
    return _LIMITS[mode] if len(run.manifest.limit_parameters) == 1 else _BOUNDS[mode]


def output_panel(run: Record) -> Panel:
    """Show y and the reference; and what it was filtered from."""
    lines: tuple[Line, ...] = (Line("y_r", "$y_r$", RED, "--"), Line("y", "$y$"))
    reference = run.settings.reference
    if reference is not None and reference.command.filter is not None:
        lines = (Line(COMMAND, "$y_{cmd}$", GREY, ":"), *lines)
    return Panel(lines, "$y,\\ y_r$" + unit_text(run.manifest, "y"))


def error_panel(run: Record) -> Panel:
    """Show e and its parts r1, or chi1, and z1; only e where that is 0, and e is z1."""
    driven = compensator_states(run.manifest)
    parts: tuple[Line, ...] = (Line("z1", "$z_1$", RED, ":"),)
    if driven:
        parts = (Line(driven[0], symbol(driven[0]), BLUE, "--"), *parts)
    if not driven or not run[driven[0]].any():
        parts = ()
    return Panel((*parts, Line("e", "$e$")), "$e$" + unit_text(run.manifest, "y"))


def miss_panels(manifest: Manifest) -> tuple[Panel, ...]:
    """Show the estimation errors, a panel for each unit."""
    lines = [
        Line(f"x{i}-x_hat{i}", f"$x_{i} - \\hat{{x}}_{i}$", COLOURS[(i - 1) % 4])
        for i in range(1, manifest.n + 1)
    ]
    return by_unit(manifest, lines, "$x - \\hat{x}$")


def _rate(manifest: Manifest) -> Panel:
    """Show a joint's angular velocity."""
    return single(manifest, RATE, "$\\dot\\theta$")


def _state(run: Record, i: int) -> tuple[tuple[Panel, ...], str]:
    """Show one state; a joint's x2 and so on are coordinates of the design: the velocity stands beside x2."""
    panel = single(run.manifest, f"x{i}", f"$x_{i}$")
    if not pressures(run):
        return (panel,), f"State $x_{i}$."
    if i > 2:
        return (panel,), f"Coordinate $x_{i}$ of the design."
    return (
        _rate(run.manifest),
        panel,
    ), "Angular velocity $\\dot\\theta$, and $x_2$, a coordinate of the design."


def _input_panels(run: Record) -> tuple[Panel, ...]:
    unit, levels = unit_text(run.manifest, "u"), _limits(run)
    return (
        Panel((Line("v", "$v$", BLUE),), "$v$" + unit, input_clip(run), levels),
        Panel((Line("u", "$u$"),), "$u$" + unit, None, levels),
    )


def _estimate_panels(manifest: Manifest) -> tuple[Panel, ...]:
    return tuple(
        Panel(
            (Line(f"x{i}", f"$x_{i}$"), Line(f"x_hat{i}", f"$\\hat{{x}}_{i}$", RED, "--")),
            f"$x_{i}$" + unit_text(manifest, f"x{i}"),
        )
        for i in range(1, manifest.n + 1)
    )


def _pressure_panels(run: Record) -> tuple[Panel, ...]:
    """Show both muscles' pressures between empty and full, and each component of D that acts, or the last."""
    limit, names = pressures(run)["P1"].limit / PASCALS_IN_BAR, disturbance_names(run)
    lines = (
        Line("P1", "$P_1$", BLUE, unit=PASCALS_IN_BAR),
        Line("P2", "$P_2$", RED, "--", unit=PASCALS_IN_BAR),
    )
    acting = [name for name in names if run[name].any()] or names[-1:]
    left_out = (single(run.manifest, name, f"$D_{name[1:]}$") for name in acting)
    return Panel(lines, "$P_1,\\ P_2$ (bar)", marks=(0.0, limit)), *left_out


def _pressure_text(run: Record) -> str:
    """Describe which pressures were clipped, and D."""
    clipped = [f"${name[0]}_{name[1]}$" for name, item in pressures(run).items() if item.clipped]
    cut = f" ({' and '.join(clipped)} clipped)" if clipped else ""
    return (
        f"Muscle pressures between empty and $P_{{\\max}}${cut}; components of $D$ (12) that act: what the "
        "design neglects of the physics, and the model mismatch."
    )


def _limits(run: Record) -> tuple[float, ...]:
    """Give the actuator's limits in this run, in the unit of u."""
    return run.manifest.limits(run.settings.parameters)


def input_clip(run: Record) -> float | None:
    """Clip v in the whole run if the transient has its own panel, so that the rest is visible."""
    return 1.35 * max(map(abs, _limits(run))) if transient_window(run) else None


def _saturation_text(run: Record) -> str:
    """List when the actuator is saturated, up to four intervals."""
    intervals = saturated_intervals(run)
    if not intervals or len(intervals) > 4:
        return "."
    spans = ", ".join(
        f"at {limit_name(run, mode)} for {start:.4g}$-${stop:.4g} s" for start, stop, mode in intervals
    )
    return f", {spans}."


def _settings_caption(run: Record, notes: Sequence[str]) -> str:
    """List what is assumed or changed, and how a failed run ended."""
    failed = "" if run.status == Status.DONE else f" The run {plain(run.message)}."
    return plain(sentence(run, notes)).replace("y_r =", "$y_r$ =") + failed


def bare(name: str) -> str:
    """The symbol of a column, to stand inside of mathematics."""
    return symbol(name).strip("$")


def plain(text: str) -> str:
    """Text that Matplotlib prints as it is, dollars included."""
    return text.replace("$", r"\$")
