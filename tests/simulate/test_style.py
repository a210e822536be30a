"""Colours of figures: distinct for readers with any kind of colour vision, and dark enough on white."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import numpy.typing as npt
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.simulate.sheets import overview_panels, sheets
from pmjoint_codegen.simulate.style import BLACK, BLUE, GREY, RED, RUST, STONE, wrapped
from pmjoint_codegen.sweep import maps
from pmjoint_codegen.tune import figure as tuned

Array = npt.NDArray[np.float64]

# Machado, Oliveira and Fernandes, "A physiologically-based model for simulation of color vision deficiency",
# IEEE TVCG 15 (2009), severity 1.0: matrices on linear sRGB.
VISION = {
    "full": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
DISTINCT = 20.0  # CIELAB distance of thin lines; a just noticeable difference of large patches is 2.3
READABLE = 4.5  # contrast of text on white, WCAG 2 level AA
VISIBLE = 3.0  # contrast of lines, likewise


def linear(colour: str) -> Array:
    """Return a colour #rrggbb as linear sRGB, shape (3,)."""
    values = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def lab(rgb: Array) -> Array:
    """Return linear sRGB as CIELAB under D65, shape (3,)."""
    to_xyz = np.array(
        [
            [0.4124564, 0.3575761, 0.1804375],
            [0.2126729, 0.7151522, 0.0721750],
            [0.0193339, 0.1191920, 0.9503041],
        ]
    )
    x, y, z = np.cbrt(np.maximum(to_xyz @ np.clip(rgb, 0.0, 1.0) / to_xyz.sum(axis=1), (6 / 29) ** 3))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def distance(first: str, second: str, vision: str) -> float:
    """Return the CIELAB distance of two colours as somebody with this vision sees them."""
    a, b = (lab(VISION[vision] @ linear(colour)) for colour in (first, second))
    return float(np.linalg.norm(a - b))


def contrast(colour: str) -> float:
    """Return the contrast of a colour with white, as WCAG 2 defines it."""
    return float(1.05 / (np.array([0.2126, 0.7152, 0.0722]) @ linear(colour) + 0.05))


@pytest.mark.parametrize("vision", VISION)
def test_curves_of_a_panel_differ_in_colour_or_dash(vision: str) -> None:
    for model in ("paper", "joint", "joint-lag", "third-order"):
        run = ClosedLoop.load(model).simulate()
        for panel in (*overview_panels(run), *(panel for sheet in sheets(run) for panel in sheet.panels)):
            for first, second in combinations(panel.lines, 2):
                apart = distance(first.colour, second.colour, vision)
                assert apart >= DISTINCT or first.dash != second.dash, (panel.label, first, second, apart)


@pytest.mark.parametrize("vision", VISION)
def test_curves_of_sweeps_and_searches_differ_in_colour_or_dash(vision: str) -> None:
    for colours, dashes in ((maps.COLOURS, maps.DASHES), (tuned.COLOURS, ("-", "-"))):
        for (first, a), (second, b) in combinations(zip(colours, dashes, strict=True), 2):
            assert distance(first, second, vision) >= DISTINCT or a != b, (first, second)


@pytest.mark.parametrize("vision", VISION)
def test_filled_histograms_differ_in_colour_alone(vision: str) -> None:
    for first, second in combinations(maps.COLOURS, 2):
        assert distance(first, second, vision) >= DISTINCT, (first, second)


def test_colours_that_are_too_alike_would_be_found() -> None:
    assert distance("#a0522d", "#55702d", "full") > DISTINCT > distance("#a0522d", "#55702d", "deuteranopia")


def test_text_and_lines_are_dark_enough() -> None:
    assert min(map(contrast, (BLACK, BLUE, RED, GREY))) >= READABLE  # grey also writes
    assert min(map(contrast, (RUST, STONE))) >= VISIBLE


def test_a_caption_counts_what_is_printed() -> None:
    assert wrapped(r"at $-u_{\max}$ so", 10) == [r"at $-u_{\max}$", "so"]  # at -umax: 8 characters
    assert wrapped(r"at $\hat{x}$ so", 7) == [r"at $\hat{x}$ so"]
