"""The documentation's figures have the look of all others, whatever Matplotlib's surroundings say."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl

from docs import draw
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.simulate import style

SPOILED: Any = {"axes.facecolor": "black", "lines.linestyle": ":", "xtick.labelsize": 20.0}


def test_the_surroundings_do_not_show() -> None:
    loop = ClosedLoop.load("paper", notify=lambda line: None)
    runs = [loop.simulate(compensator=switch, horizon=1.5) for switch in (True, False)]
    plain = style.png(draw.compensator_figure(*runs), draw.LOOK)
    with mpl.rc_context(SPOILED):
        assert style.png(draw.compensator_figure(*runs), draw.LOOK) == plain


def test_its_ticks_are_those_of_every_figure() -> None:
    loop = ClosedLoop.load("paper", notify=lambda line: None)
    run = loop.simulate(horizon=0.1)
    figure = draw.compensator_figure(run, run)
    (label, *_) = figure.axes[0].get_xticklabels()
    assert label.get_fontsize() == style.BASE["xtick.labelsize"]
    assert figure.axes[0].spines["left"].get_linewidth() == style.BASE["axes.linewidth"]
