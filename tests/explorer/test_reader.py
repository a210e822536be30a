"""The page for every reader: keyboard, screen reader, colours, a phone, a frame; and what it does with a bad link."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from .conftest import Shown
from .devtools import Browser, Tab

ACTS = {"button", "slider", "spinbutton", "radio", "textbox", "DisclosureTriangle", "image", "region", "form"}
TARGET = 24  # px, the least side of what a finger or a pointer hits
FINGER = 44  # px, of what a finger hits on a phone, but for a button that undoes one slider
CONTRAST = 4.5  # of text: WCAG 2, AA

# The contrast of every element with text of its own, against what lies behind it.
CONTRASTS = """
(() => {
  const canvas = new OffscreenCanvas(1, 1).getContext("2d", {willReadFrequently: true});
  const paint = (...layers) => {
    canvas.clearRect(0, 0, 1, 1);
    for (const layer of layers) { canvas.fillStyle = layer; canvas.fillRect(0, 0, 1, 1); }
    return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3);
  };
  const light = (rgb) => rgb.map((c) => c / 255).map((c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const found = [];
  const check = (what, ink, behind) => {
    const [a, b] = [light(paint(...behind, ink)), light(paint(...behind))];
    found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), what]);
  };
  for (const node of document.querySelectorAll("body *")) {
    const text = [...node.childNodes].some((child) => child.nodeType === 3 && child.data.trim());
    if (!(text || node.matches("input[type=number]")) || !node.checkVisibility() || node.matches("script, .hidden")) continue;
    const behind = [];
    for (let at = node; at; at = at.parentElement) behind.unshift(getComputedStyle(at).backgroundColor);
    check(node.tagName + " " + node.textContent.trim().slice(0, 30), getComputedStyle(node).color, behind);
  }
  const { colors } = explorer;
  for (const name of ["soft", "ink", "orange"]) check(`canvas ${name}`, colors[name], [colors.card]);
  return found.sort((a, b) => a[0] - b[0]);
})()
"""


def focused(tab: Tab) -> str:
    """What has the focus: its id, or its words."""
    found: str = tab.evaluate(
        "(e => e === document.body ? '' : e.id || e.getAttribute('aria-label') || e.value || e.textContent)"
        "(document.activeElement)"
    )
    return found


def spoken(tab: Tab) -> str:
    """What the status line says once the page is at rest."""
    tab.evaluate("new Promise(done => setTimeout(done, REST + 50))")
    found: str = tab.evaluate("document.getElementById('spoken').textContent")
    return found


def test_tab_reaches_every_control_once_and_leaves(tab: Tab) -> None:
    """In order, with a visible outline, and without a trap: after the last comes the browser's own."""
    count = tab.evaluate("document.querySelectorAll('button, input, canvas, summary').length")
    reached: list[str] = []
    for _ in range(count + 10):
        tab.strike("Tab")
        name = focused(tab)
        if name == "" or name in reached:
            break
        assert tab.evaluate(
            "(s => s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 1)"
            "(getComputedStyle(document.activeElement.matches('input[type=radio]')"
            " ? document.activeElement.parentElement : document.activeElement))"
        ), name
        reached.append(name)
    sliders = tab.evaluate("[...document.querySelectorAll('#controls > fieldset input[type=range]')].map(e => e.id)")
    plots = [f"plot-{name}" for name in ("output", "error", "input", "compensator", "lyapunov", "plane")]
    assert reached[:4] == ["reset", "keep", "copy-link", "copy-command"]
    assert reached[4:10] == plots
    assert set(sliders) < set(reached) and {"row-c1", "row-u_max", "row-horizon"} < set(sliders)
    assert {"compensator", "zero", "continuous"} < set(reached)  # of each choice, the one that is chosen


def test_keys_move_a_slider_and_the_run_follows(tab: Tab) -> None:
    """Each arrow has an effect, wherever the slider stands; Home and End are the ends; the change is announced."""
    tab.evaluate("document.getElementById('row-ck1').focus()")
    value = "explorer.settings.values.ck1 ?? 1"
    seen = [tab.evaluate(value)]
    for key in ("ArrowRight",) * 12 + ("PageUp",) * 3 + ("ArrowLeft",) * 12 + ("End", "Home"):
        tab.strike(key)
        seen.append(tab.evaluate(value))
    assert all(a != b for a, b in zip(seen, seen[1:], strict=False)), seen
    assert seen[-2:] == [10, 0.1]
    assert "Largest error" in spoken(tab)
    assert "p.ck1=0.1" in tab.evaluate("location.hash")
    assert tab.evaluate("document.activeElement.getAttribute('aria-valuetext')") == "0.1 1/s"


def test_keys_choose_read_a_plot_and_undo(tab: Tab) -> None:
    tab.evaluate("document.querySelector('input[value=compensator]').focus()")
    tab.press("ArrowRight")
    assert tab.evaluate("explorer.settings.saturation") == "braking"
    tab.press("ArrowRight")
    assert "r1 is exactly 0" in tab.evaluate(
        "explorer.rest(), document.getElementById('plot-compensator').getAttribute('aria-label')"
    )
    tab.evaluate("document.getElementById('plot-input').focus()")
    tab.press("Home")
    assert tab.evaluate("document.getElementById('spoken').textContent").startswith("t 0 s: v −225.7 V, u −10 V")
    tab.press("End")
    assert tab.evaluate("document.getElementById('spoken').textContent").startswith("t 20 s: ")
    tab.press("Escape")
    assert tab.evaluate("document.querySelector('figure output').textContent") == ""
    tab.evaluate("document.getElementById('reset').focus()")
    tab.press("Enter")
    assert tab.evaluate("toHash(explorer.data, explorer.settings)") == ""
    assert tab.evaluate("document.activeElement.id") == "reset"


def test_the_pointer_reads_values_without_moving_the_page(tab: Tab) -> None:
    height = tab.evaluate("document.documentElement.scrollHeight")
    box = tab.evaluate("(r => [r.x + r.width / 2, r.y + 40])(document.getElementById('plot-error').getBoundingClientRect())")
    tab.mouse("mouseMoved", *box)
    tab.frame()
    text = tab.evaluate("[...document.querySelectorAll('figure output')].map(e => e.textContent)")
    assert re.fullmatch(r"t \S+ s: e \S+ rad", text[1])
    assert all(text) and tab.evaluate("document.documentElement.scrollHeight") == height


def test_a_drag_redraws(tab: Tab) -> None:
    """A slider pulled with the mouse: runs follow while it is held."""
    x, y, width = tab.evaluate(
        "(e => (e.scrollIntoView(), (r => [r.x, r.y + r.height / 2, r.width])(e.getBoundingClientRect())))"
        "(document.getElementById('row-c1'))"
    )
    seen = set()
    tab.mouse("mousePressed", x + width / 2, y, held=True)
    for i in range(1, 6):
        tab.mouse("mouseMoved", x + width / 2 + 8 * i, y, held=True)
        tab.frame()
        seen.add(tab.evaluate("explorer.run.ise"))
    tab.mouse("mouseReleased", x + width / 2 + 40, y, held=True)
    assert len(seen) == 5


def test_everything_that_acts_has_a_name_and_the_run_has_words(tab: Tab) -> None:
    """The tree that a screen reader walks."""
    tab.evaluate("for (const node of document.querySelectorAll('details')) node.open = true")
    tab.frame()
    nodes = [(node["role"]["value"], node.get("name", {}).get("value", "")) for node in tab.tree()]
    roles = {role for role, _ in nodes}
    assert {"slider", "spinbutton", "radio", "button", "image", "status", "MathMLMath", "table", "main"} <= roles
    assert [role for role, name in nodes if role in ACTS and not name.strip()] == []
    names = [name for role, name in nodes if role in ("slider", "spinbutton", "button", "image")]
    assert len(set(names)) == len(names)  # none is confused with another
    [plot] = [name for role, name in nodes if role == "image" and name.startswith("Input")]
    assert "v from −225.7 V to 24.66 V" in plot and "|v| reaches 226" in plot and "at a limit for 0.2049 s" in plot
    levels = tab.evaluate("[...document.querySelectorAll('h1, h2')].map(e => e.tagName)")
    assert levels[0] == "H1" and levels.count("H1") == 1
    assert tab.evaluate("document.documentElement.lang") == "en"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out(tab: Tab, scheme: str) -> None:
    tab.evaluate("for (const node of document.querySelectorAll('details')) node.open = true")
    tab.evaluate("explorer.settings.values.c1 = 0, explorer.update()")  # its message too
    tab.prefer({"prefers-color-scheme": scheme})
    tab.evaluate("document.body.classList.remove('lost')")  # what is faded then is out of date
    found = tab.evaluate(CONTRASTS)
    assert len(found) > 150
    assert [entry for entry in found if entry[0] < CONTRAST] == []
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == {
        "light": "rgb(251, 251, 249)",
        "dark": "rgb(20, 23, 26)",
    }[scheme]


def test_forced_colours_and_still_readers(tab: Tab) -> None:
    """What is chosen stays visible where the system sets colours; nothing moves where it should not."""
    tab.prefer({"forced-colors": "active", "prefers-reduced-motion": "reduce"})
    chosen, other = tab.evaluate(
        "['compensator', 'clip'].map(v => getComputedStyle(document.querySelector(`input[value=${v}]`).parentElement)"
        ".backgroundColor)"
    )
    assert chosen != other
    assert tab.evaluate("explorer.colors.ink") == "CanvasText"
    assert tab.evaluate("getComputedStyle(document.getElementById('reset')).transitionDuration") == "0s"


@pytest.mark.parametrize("width", [320, 390])
def test_a_phone_shows_it_all(browser: Browser, paper: Shown, width: int) -> None:
    """No scrolling to the side; targets for a finger; the plot in sight while a slider is moved."""
    tab = browser.open(paper.address, width=width, height=844, phone=True)
    tab.evaluate("for (const node of document.querySelectorAll('details')) node.open = true")
    tab.frame()
    assert tab.evaluate("document.documentElement.scrollWidth") == width
    sizes: dict[str, Any] = tab.evaluate(
        "Object.fromEntries([...document.querySelectorAll('button, .choices label, summary, #controls .row input')].map("
        "e => [e.id || e.getAttribute('aria-label') || e.textContent, (r => [r.width, r.height])(e.getBoundingClientRect())]))"
    )
    assert len(sizes) > 50
    small = {name: size for name, size in sizes.items() if min(size) < (TARGET if " back to " in name else FINGER)}
    assert small == {}
    wide, high = tab.evaluate("(p => [p.box.w, p.box.h])(explorer.panels[0].plot)")
    assert wide > 180 and high > 120
    tab.evaluate("document.getElementById('row-horizon').scrollIntoView({block: 'center'})")
    tab.frame()
    top, bottom = tab.evaluate("(r => [r.top, r.bottom])(document.getElementById('plot-output').getBoundingClientRect())")
    assert 0 <= top < bottom < 844 / 2
    x, y = tab.evaluate("(r => [r.x + r.width / 2, r.y + r.height / 2])(document.getElementById('row-horizon').getBoundingClientRect())")
    before = tab.evaluate("explorer.run.ise")
    tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    tab.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": x - 60, "y": y}])
    tab.frame()
    tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    tab.frame()
    assert tab.evaluate("explorer.run.ise") != before
    tab.close()


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ("model=joint-12345678&p.c1=20", "The link is for joint-12345678"),
        ("p.c1=x&p.nothing=1&f.toString=2&x0=1&saturation=all&horizon=-1&p.u_max=", "left out: p.c1=x, p.nothing=1"),
        ("%E0%A4%A&p.c1=1e999", "left out:"),
        ("<img src=x onerror=alert(1)>", "left out: <img src=x onerror=alert(1)>"),
    ],
)
def test_a_bad_link_is_refused_in_words(browser: Browser, paper: Shown, link: str, words: str) -> None:
    tab = browser.open(f"{paper.address}#{link}")
    assert words in tab.evaluate("document.getElementById('notice').textContent")
    assert tab.evaluate("toHash(explorer.data, explorer.settings)") == ""
    assert tab.evaluate("explorer.run.status") == 1
    tab.evaluate("explorer.controls.show(), explorer.changed()")
    assert tab.evaluate("document.getElementById('notice').hidden")
    tab.close()


def test_settings_that_no_run_allows_are_refused_in_words(tab: Tab) -> None:
    for values, words in (
        ({"c1": 0}, "c1 is 0; allowed: a number greater than 0"),
        ({"k1": -1}, "leave the filters unstable"),
    ):
        tab.evaluate(f"explorer.settings.values = {json.dumps(values)}, explorer.update()")
        assert words in tab.evaluate("document.getElementById('alert').textContent")
    tab.evaluate("explorer.settings.values = {}, explorer.settings.x0 = [70.2, 0], explorer.update()")
    assert tab.evaluate("document.getElementById('alert').hidden") is tab.evaluate("explorer.run.status === 1")
    tab.evaluate("Object.assign(explorer.settings, {controller: 'sampled', sample_time: 1000}), explorer.update()")
    assert "the sample time exceeds the horizon" in tab.evaluate("document.getElementById('alert').textContent")


@pytest.mark.parametrize("box", ["", 'sandbox="allow-scripts"'])
def test_it_runs_in_a_frame(browser: Browser, paper: Shown, tmp_path: Path, box: str) -> None:
    """In a page of its own and in a sandbox, from disk: an address and a clipboard that it may not use do no harm."""
    file = tmp_path / "around.html"
    told = "onmessage = e => document.documentElement.dataset.ready = e.data"
    file.write_text(f'<script>{told}</script><iframe {box} width="900" height="700" src="inner.html"></iframe>')
    probe = (
        "<script>addEventListener('error', e => parent.postMessage('error ' + e.message, '*'));"
        "addEventListener('unhandledrejection', e => parent.postMessage('error ' + e.reason, '*'));"
        "(async () => { while (!document.documentElement.dataset.ready) await new Promise(go => setTimeout(go, 5));"
        " explorer.settings.values.c1 = 20; explorer.update(); explorer.rest();"
        " await explorer.copy(document.getElementById('copy-command'), 'words');"
        " parent.postMessage('run ' + explorer.run.status, '*'); })()</script>"
    )
    (tmp_path / "inner.html").write_text(paper.page.html.replace("</body>", f"{probe}</body>"), encoding="utf-8")
    tab = browser.open(file.as_uri(), width=1000, height=800)
    assert tab.evaluate("document.documentElement.dataset.ready") == "run 1"
    tab.close()
