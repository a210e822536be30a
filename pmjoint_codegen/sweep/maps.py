"""Figures of a sweep: maps over two axes, curves over one, histograms over draws.

Compensator on and off stand side by side. Like the figures of a run, these are drawn without Matplotlib's
global state.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen import storage
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.metrics import REPORTED
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.style import BLUE, RUST, STONE, png, rendered, styled, wrapped
from pmjoint_codegen.sweep.gaps import absence, unsettled
from pmjoint_codegen.sweep.labels import symbol, unit
from pmjoint_codegen.sweep.plan import DRAW, SATURATION
from pmjoint_codegen.sweep.region import Border, border, held, held_share
from pmjoint_codegen.values import COMPENSATOR, OWN_SUFFIX, of_plant

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure


PANEL: Final = (3.05, 2.55)  # inches
CHARACTERS: Final = 20  # of a caption, per inch
BINS: Final = 60
FEWEST_BINS: Final = 8
FEW_DECADES: Final = 1e3
ALIKE: Final = 1e-9  # relative: values that differ by rounding or tolerance only
LOST: Final = "#c9c6c1"
COLOURS: Final = (BLUE, RUST, STONE)
DASHES: Final = ("-", "--", "-.")
MOST_CELLS: Final = 1024  # drawn along an axis: more would exceed the pixels
FOUR: Final = ("ise", "settling_s", "max_abs_e", "max_abs_v")
_STYLE: Final = {
    "font.size": 9.0,
    "axes.formatter.use_mathtext": True,
    "xtick.major.pad": 5.0,  # the lowest label beside the axis ends below it
    "axes.titlesize": 9.5,
    "legend.fontsize": 8.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
}


@dataclass(frozen=True)
class Case:
    """The runs with one kind of saturation, or all.

    Attributes:
        title: empty for all runs.
        data: its runs.
    """

    title: str
    data: xr.Dataset


def write_maps(dataset: xr.Dataset, manifest: Manifest, folder: Path) -> tuple[Path, ...]:
    """Draw the figures that suit the dimensions of a sweep, as PNG files.

    Raises:
        UsageError: a file cannot be written.
    """
    paths = []
    with styled(_STYLE):
        for stem, figure in _figures(_ascending(dataset), manifest).items():
            path = folder / f"{stem}.png"
            storage.write_bytes(path, png(figure, _STYLE))
            paths.append(path)
    return tuple(paths)


def region_figure(dataset: xr.Dataset, manifest: Manifest) -> bytes:
    """Draw the region over the first two axes of a sweep, or curves over its only one, as bytes of SVG."""
    x, *further = (str(name) for name in dataset["status"].dims[:2])
    runs = _ascending(dataset)
    with styled(_STYLE):
        figure = region(runs, manifest, x, further[0], "") if further else curves(runs, x)
        return rendered(figure, _STYLE, "svg")


def _ascending(dataset: xr.Dataset) -> xr.Dataset:
    """The axes in ascending order, whatever the order of the request."""
    names = [str(name) for name in dataset["status"].dims]
    return dataset.sortby([name for name in names if np.any(np.diff(dataset[name].values) < 0)])


def _figures(dataset: xr.Dataset, manifest: Manifest) -> dict[str, Figure]:
    names = [str(name) for name in dataset["status"].dims if name not in (DRAW, COMPENSATOR, SATURATION)]
    if DRAW in dataset["status"].dims or not names:
        return {"histograms": histograms(dataset)} if DRAW in dataset["status"].dims else {}
    if len(names) == 1:
        return {"curves": curves(dataset, names[0])}
    x, y = names[:2]
    sliced, note = _slice(dataset, names[2:])
    states = set(manifest.start.names)
    figures = {"region": region(sliced, manifest, x, y, note)} if {x, y} <= states else {}
    for name, column in REPORTED.items():
        if column.row.mapped:
            figures[f"map_{name}"] = metric_map(sliced, name, x, y, note)
    return figures


def _slice(dataset: xr.Dataset, names: Sequence[str]) -> tuple[xr.Dataset, str]:
    """The middle of every further axis, and the text for it."""
    sliced = dataset.isel({name: dataset.sizes[name] // 2 for name in names})
    return sliced, ", ".join(f"{name} = {float(sliced[name]):g}" for name in names)


def _thinned(dataset: xr.Dataset, *names: str) -> tuple[xr.Dataset, str]:
    """Every second, third, … value of axes that are longer than a figure is wide, and the text for it."""
    steps = {name: -(-dataset.sizes[name] // MOST_CELLS) for name in names}
    words = ", ".join(f"1 in {step} values of {symbol(name)}" for name, step in steps.items() if step > 1)
    thinned = dataset.isel({name: slice(None, None, step) for name, step in steps.items()})
    return thinned, f" Drawn: {words}." if words else ""


def cases(dataset: xr.Dataset) -> tuple[Case, ...]:
    """The sweep by what is done about saturation, or as a whole if that is not varied."""
    name = next((name for name in (COMPENSATOR, SATURATION) if name in dataset.dims), None)
    if name is None:
        return (Case("", dataset),)
    titles = {1.0: "with the compensator (23)", 0.0: "plain clipping, $r = 0$", 2.0: "braking"}
    values = sorted(dataset[name].values.tolist(), key=lambda code: (code == 2.0, -code))
    return tuple(Case(titles.get(value, "not simulated"), dataset.sel({name: value})) for value in values)


def region(dataset: xr.Dataset, manifest: Manifest, x: str, y: str, note: str) -> Figure:
    """Region of attraction: settling time where the joint stays bounded; grey where it diverges."""
    shares = [100 * held_share(case.data) for case in cases(dataset)]
    dataset, thinned = _thinned(dataset, x, y)
    columns = cases(dataset)
    figure, panels = _canvas(len(columns))
    line = border(manifest, _fixed(dataset)) if (x, y) == ("x1", "x2") else None
    for case, share, panel in zip(columns, shares, panels, strict=True):
        good = held(case.data)
        image = _image(
            panel, case.data["settling_s"].where(good), x, y, (0.0, float(dataset.attrs["horizon"]))
        )
        undefined = good.copy(data=np.where(good & case.data["settling_s"].isnull(), 1.0, np.nan))
        _image(panel, undefined, x, y, (0.0, 1.0), colours="Greys_r")
        if line is not None:
            _draw_border(panel, case.data, line)
        words = f"{share:.1f} % held"
        panel.set_title(f"{case.title}: {words}" if case.title else words)
        _labels(panel, dataset, x, y)
    figure.colorbar(image, ax=panels, label="settling (s)", fraction=0.05, pad=0.02)
    dashed = " Dashed: beyond it, no input within the limit counters the worst disturbance." if line else ""
    _caption(
        figure,
        dataset,
        f"{absence('Grey', dataset)}{unsettled(dataset)}{dashed}{thinned}".strip(),
        note,
    )
    return figure


def metric_map(dataset: xr.Dataset, name: str, x: str, y: str, note: str) -> Figure:
    """One metric over two axes."""
    dataset, thinned = _thinned(dataset, x, y)
    columns = cases(dataset)
    figure, panels = _canvas(len(columns))
    row = REPORTED[name].row
    shown = [case.data[name].where(held(case.data)) for case in columns]
    finite = np.concatenate([values.values[np.isfinite(values.values)] for values in shown])
    limits = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    steep = row.logarithmic and _decade(finite)
    for case, values, panel in zip(columns, shown, panels, strict=True):
        image = _image(panel, values, x, y, limits, steep=steep)
        panel.set_title(case.title)
        _labels(panel, dataset, x, y)
    bar = figure.colorbar(
        image, ax=panels, label=f"{row.words} ({unit(dataset[name])})", fraction=0.05, pad=0.02
    )
    if steep:
        _plain_ticks(bar, limits)
    _caption(figure, dataset, f"{absence('Grey', dataset, name)}{thinned}".strip(), note)
    return figure


def _plain_ticks(bar: Colorbar, limits: tuple[float, float]) -> None:
    """Plain tick numbers for a logarithmic scale, more of them if it spans few decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    few = limits[1] < FEW_DECADES * limits[0]
    bar.minorticks_off()
    bar.set_ticks(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    bar.formatter = FuncFormatter(lambda value, _: f"{value:g}")
    bar.update_ticks()


def curves(dataset: xr.Dataset, x: str) -> Figure:
    """Metrics over one axis, a line for each case."""
    figure, panels = _canvas(2, 2)
    for name, panel in zip(FOUR, panels, strict=True):
        row = REPORTED[name].row
        for case, colour, dash in zip(cases(dataset), COLOURS, DASHES, strict=False):
            places, values = case.data[x].values, case.data[name].where(held(case.data)).values
            panel.plot(places, values, dash, color=colour, lw=1.0, label=case.title or None)
            alone = _alone(values)
            panel.plot(places[alone], values[alone], color=colour, ls="", marker=".", ms=4.0)
        if row.logarithmic and _decade(dataset[name].where(held(dataset)).values):
            panel.set_yscale("log")
        panel.set_xlabel(_label(dataset, x))
        panel.set_ylabel(f"{row.words} ({unit(dataset[name])})")
    if len(cases(dataset)) > 1:
        panels[0].legend()
    _caption(figure, dataset, absence("Gaps", dataset, *FOUR), "")
    return figure


def _decade(values: Array) -> bool:
    """Whether a logarithmic scale is useful: positive values that span more than a decade."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() > 0 and finite.max() > 10 * finite.min())


def _alone(values: Array) -> npt.NDArray[np.bool_]:
    """Which points have no neighbour to be joined to by a line."""
    there = np.concatenate([[False], np.isfinite(values), [False]])
    return np.asarray(there[1:-1] & ~there[:-2] & ~there[2:])


def histograms(dataset: xr.Dataset) -> Figure:
    """Distribution over all draws (and grid points) that stay bounded, of each metric that differs.

    Metrics that are the same in all of these runs stand in the caption.
    """
    columns = cases(dataset)
    found = {name: [_bounded(case, name) for case in columns] for name in FOUR}
    drawn = [name for name in FOUR if _spread(np.concatenate(found[name]))]
    figure, panels = _canvas(min(2, max(1, len(drawn))), max(1, (len(drawn) + 1) // 2))
    for panel in panels:
        panel.set_facecolor("white")
    for panel in panels[max(1, len(drawn)) :]:
        panel.remove()
    for name, panel in zip(drawn, panels, strict=False):
        _histogram(panel, found[name], [case.title for case in columns])
        panel.set_xlabel(f"{REPORTED[name].row.words} ({unit(dataset[name])})")
        panel.set_ylabel("runs")
    if not drawn:
        panels[0].set_axis_off()
        panels[0].text(0.5, 0.5, "nothing differs", ha="center", transform=panels[0].transAxes)
    elif len(columns) > 1:
        panels[0].legend()
    told = ", ".join(
        f"{symbol(name)} ~ {law}({a:g}, {b:g})" for name, law, a, b in json.loads(dataset.attrs["samples"])
    )
    share = 100 * float(held(dataset).mean())
    words = f"{told}. {dataset['status'].size} runs, {share:.4g} % bounded. Lines: medians."
    _caption(figure, dataset, f"{words}{_alike(dataset, found, drawn)}", "")
    return figure


def _bounded(case: Case, name: str) -> Array:
    """The finite values of a metric in the runs that stay bounded."""
    values = case.data[name].values[held(case.data).values]
    return np.asarray(values[np.isfinite(values)], dtype=np.float64)


def _spread(values: Array) -> bool:
    """Whether values differ by more than rounding or tolerance."""
    return bool(values.size and np.ptp(values) > ALIKE * np.max(np.abs(values)))


def _alike(dataset: xr.Dataset, found: Mapping[str, Sequence[Array]], drawn: Sequence[str]) -> str:
    """The metrics that are the same in all runs, for the caption."""
    same = [
        f"{REPORTED[name].row.words} {float(np.median(np.concatenate(values))):.6g} {unit(dataset[name])}"
        for name, values in found.items()
        if name not in drawn and np.concatenate(values).size
    ]
    return f" The same in all: {', '.join(same)}." if same else ""


def _histogram(panel: Axes, values: Sequence[Array], titles: Sequence[str]) -> None:
    """Count the values of each case in the same bins; a line at each median."""
    from matplotlib.ticker import MaxNLocator

    every = np.concatenate(values)
    low, high = (
        float(end) for end in np.percentile(every, (0.1, 99.9))
    )  # a few outliers would squeeze the rest
    bins = int(np.clip(np.sqrt(every.size), FEWEST_BINS, BINS))
    for own, title, colour in zip(values, titles, COLOURS, strict=False):
        if own.size:
            shape: dict[str, Any] = {"histtype": "stepfilled", "alpha": 0.5, "label": title or None}
            panel.hist(own, bins, range=(low, high), color=colour, **shape)
            panel.axvline(float(np.median(own)), color=colour, lw=0.8)
    panel.yaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
    panel.set_ylim(0.0, 1.25 * panel.get_ylim()[1] if len(values) > 1 else None)  # room for the legend


def _canvas(columns: int, rows: int = 1) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PANEL[0] * columns + 0.8, PANEL[1] * rows + 0.55), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    if rows == 1:
        for panel in panels.ravel():
            panel.set_facecolor(LOST)
    return figure, list(panels.ravel())


def _image(
    panel: Axes,
    values: xr.DataArray,
    x: str,
    y: str,
    limits: tuple[float, float],
    *,
    steep: bool = False,
    colours: str = "viridis_r",
) -> Any:
    from matplotlib.colors import LogNorm, Normalize

    data = values.transpose(y, x)
    norm = LogNorm(*limits) if steep else Normalize(*limits)
    return panel.pcolormesh(
        _edges(data[x].values), _edges(data[y].values), data.values, cmap=colours, shading="flat", norm=norm
    )


def _edges(centres: Array) -> Array:
    """Borders of cells around ascending values, half way between them; a single value has a cell too."""
    if len(centres) == 1:
        half = 0.5 * max(abs(float(centres[0])), 1.0)
        return np.array([centres[0] - half, centres[0] + half])
    halves = np.diff(centres) / 2
    return np.concatenate([[centres[0] - halves[0]], centres[:-1] + halves, [centres[-1] + halves[-1]]])


def _draw_border(panel: Axes, data: xr.Dataset, line: Border) -> None:
    width, height = (_range(data[name].values) for name in ("x1", "x2"))
    for side in (-1.0, 1.0):
        panel.plot(side * line.offset - height / line.slope, height, color="black", lw=0.9, ls=(0, (4, 2)))
    panel.set_xlim(*width)
    panel.set_ylim(*height)


def _range(centres: Array) -> Array:
    """From the first value to the last; for a single value, its cell."""
    return centres[[0, -1]] if len(centres) > 1 else _edges(centres)


def _fixed(dataset: xr.Dataset) -> dict[str, float]:
    """The plant's value of every parameter that is the same in all runs."""
    values: dict[str, float] = json.loads(dataset.attrs["parameters"])
    varied = {str(name).removesuffix(OWN_SUFFIX) for name in dataset.coords}
    return {name: of_plant(values, name) for name in values if name.removesuffix(OWN_SUFFIX) not in varied}


def _labels(panel: Axes, dataset: xr.Dataset, x: str, y: str) -> None:
    panel.set_xlabel(_label(dataset, x))
    panel.set_ylabel(_label(dataset, y))


def _label(dataset: xr.Dataset, name: str) -> str:
    start = "(0)" if dataset[name].attrs.get("long_name") == "plant state" else ""
    return f"{symbol(name)}{start} ({unit(dataset[name])})"


def _caption(figure: Figure, dataset: xr.Dataset, words: str, note: str) -> None:
    attributes = dataset.attrs
    controller = attributes["controller"]
    if attributes["sample_time"]:
        controller += f" at {attributes['sample_time']:g} s"
    run = f"{controller}, $y_r$ = {attributes['reference']}, horizon {attributes['horizon']:g} s"
    made = f"{attributes['model']}: {run}"
    width = round(CHARACTERS * figure.get_figwidth())
    lines = [line for text in (words, f"{made}{', ' if note else ''}{note}") for line in wrapped(text, width)]
    figure.supxlabel("\n".join(lines), fontsize=7.5, color="#444444")
