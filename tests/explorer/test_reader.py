"""The page for every reader: keyboard, screen reader, colours, a phone, a frame; and what it refuses."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path

import pytest

from .conftest import Shown, opened
from .devtools import Browser, Tab

ACTS = {
    *("button", "slider", "spinbutton", "radio", "textbox"),
    *("DisclosureTriangle", "image", "region", "form"),
}
TARGET = 24  # px, the least side of what a finger or a pointer hits
FINGER = 44  # px, of what a finger hits on a phone, but for a button that undoes one slider
CONTRAST = 4.5  # of text: WCAG 2, AA
PLOTS = [f"plot-{name}" for name in ("output", "error", "input", "compensator", "lyapunov", "plane")]
PAPER = {"light": "rgb(251, 251, 249)", "dark": "rgb(20, 23, 26)"}

# Inside a frame: what goes wrong, or how the run ended, is told to the page around it.
INSIDE = """<script>
const tell = (text) => parent.postMessage(text, "*");
addEventListener("error", (event) => tell(`error ${event.message}`));
addEventListener("unhandledrejection", (event) => tell(`error ${event.reason}`));
(async () => {
  while (!document.documentElement.dataset.ready) await new Promise((go) => setTimeout(go, 5));
  explorer.settings.values.c1 = 20;
  explorer.update();
  explorer.rest();
  await explorer.copy(document.getElementById("copy-command"), "words");
  tell(`run ${explorer.run.status}`);
})();
</script></body>"""


def test_tab_reaches_every_control_once_and_leaves(tab: Tab) -> None:
    """In order, with a visible outline, and without a trap: after the last comes the browser's own."""
    count = tab.evaluate("document.querySelectorAll('button, input, canvas, summary').length")
    reached: list[str] = []
    for _ in range(count + 10):
        tab.strike("Tab")
        name = tab.evaluate("probe.focused()")
        if name == "" or name in reached:
            break
        assert tab.evaluate("probe.outlined()"), name
        reached.append(name)
    sliders = "[...document.querySelectorAll('#controls > fieldset input[type=range]')].map(e => e.id)"
    expected = set(tab.evaluate(sliders))
    assert reached[:4] == ["reset", "keep", "copy-link", "copy-command"]
    assert reached[4:10] == PLOTS
    assert {"row-c1", "row-u_max", "row-horizon"} < expected < set(reached)
    assert {"compensator", "zero", "continuous"} < set(reached)  # of each choice, the one that is chosen


def test_keys_move_a_slider_and_the_run_follows(tab: Tab) -> None:
    """Each arrow has an effect, wherever the slider stands; Home and End are the ends; the change is told."""
    tab.evaluate("document.getElementById('row-ck1').focus()")
    value = "explorer.settings.values.ck1 ?? 1"
    seen = [tab.evaluate(value)]
    for key in ("ArrowRight",) * 12 + ("PageUp",) * 3 + ("ArrowLeft",) * 12 + ("End", "Home"):
        tab.strike(key)
        seen.append(tab.evaluate(value))
    assert all(a != b for a, b in itertools.pairwise(seen)), seen
    assert seen[-2:] == [10, 0.1]
    tab.evaluate("probe.rest()")
    assert "Largest error" in tab.evaluate("probe.text('spoken')")
    assert "p.ck1=0.1" in tab.evaluate("location.hash")
    assert tab.evaluate("document.activeElement.getAttribute('aria-valuetext')") == "0.1 1/s"


def test_keys_choose_read_a_plot_and_undo(tab: Tab) -> None:
    tab.evaluate("document.querySelector('input[value=compensator]').focus()")
    tab.press("ArrowRight")
    assert tab.evaluate("explorer.settings.saturation") == "braking"
    tab.press("ArrowRight")
    tab.evaluate("explorer.rest()")
    assert "r1 is exactly 0" in tab.evaluate("probe.label('plot-compensator')")
    tab.evaluate("probe.rest()")  # what it says of the run would follow what it says of the plot
    tab.evaluate("document.getElementById('plot-input').focus()")
    tab.press("Home")
    assert tab.evaluate("probe.text('spoken')").startswith("t 0 s: v −225.7 V, u −10 V")
    tab.press("End")
    assert tab.evaluate("probe.text('spoken')").startswith("t 20 s: ")
    tab.press("Escape")
    assert tab.evaluate("document.querySelector('figure output').textContent") == ""
    tab.evaluate("document.getElementById('reset').focus()")
    tab.press("Enter")
    assert tab.evaluate("toHash(explorer.data, explorer.settings)") == ""
    assert tab.evaluate("probe.focused()") == "reset"


def test_the_pointer_reads_values_without_moving_the_page(tab: Tab) -> None:
    height = tab.evaluate("document.documentElement.scrollHeight")
    x, y, width, _ = tab.evaluate("probe.box('plot-error')")
    tab.mouse("mouseMoved", x + width / 2, y + 40)
    tab.frame()
    text = tab.evaluate("[...document.querySelectorAll('figure output')].map(e => e.textContent)")
    assert re.fullmatch(r"t \S+ s: e \S+ rad", text[1])
    assert all(text)
    assert tab.evaluate("document.documentElement.scrollHeight") == height


def test_a_drag_redraws(tab: Tab) -> None:
    """A slider pulled with the mouse: runs follow while it is held."""
    tab.evaluate("document.getElementById('row-c1').scrollIntoView()")
    left, top, width, height = tab.evaluate("probe.box('row-c1')")
    x, y = left + width / 2, top + height / 2
    seen = set()
    tab.mouse("mousePressed", x, y, held=True)
    for i in range(1, 6):
        tab.mouse("mouseMoved", x + 8 * i, y, held=True)
        tab.frame()
        seen.add(tab.evaluate("explorer.run.ise"))
    tab.mouse("mouseReleased", x + 40, y, held=True)
    assert len(seen) == 5


def test_everything_that_acts_has_a_name_and_the_run_has_words(tab: Tab) -> None:
    """The tree that a screen reader walks."""
    tab.evaluate("probe.unfold()")
    tab.frame()
    nodes = [(node["role"]["value"], node.get("name", {}).get("value", "")) for node in tab.tree()]
    roles = {role for role, _ in nodes}
    assert roles >= {
        "slider",
        "spinbutton",
        "radio",
        "button",
        "image",
        "status",
        "MathMLMath",
        "table",
        "main",
    }
    assert [role for role, name in nodes if role in ACTS and not name.strip()] == []
    names = [name for role, name in nodes if role in ("slider", "spinbutton", "button", "image")]
    assert len(set(names)) == len(names)  # none is confused with another
    [plot] = [name for role, name in nodes if role == "image" and name.startswith("Input")]
    for words in ("v from −225.7 V to 24.66 V", "|v| reaches 226", "at a limit for 0.2049 s"):
        assert words in plot
    levels = tab.evaluate("[...document.querySelectorAll('h1, h2')].map(e => e.tagName)")
    assert levels[0] == "H1"
    assert levels.count("H1") == 1
    assert tab.evaluate("document.documentElement.lang") == "en"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out(tab: Tab, scheme: str) -> None:
    tab.evaluate("probe.unfold(), explorer.settings.values.c1 = 0, explorer.update()")  # its message too
    tab.prefer({"prefers-color-scheme": scheme})
    tab.evaluate("document.body.classList.remove('lost')")  # what is faded then is out of date
    found = tab.evaluate("probe.contrasts()")
    assert len(found) > 150
    assert [entry for entry in found if entry[0] < CONTRAST] == []
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == PAPER[scheme]


def test_forced_colours_and_still_readers(tab: Tab) -> None:
    """What is chosen stays visible where the system sets colours; nothing moves where it should not."""
    tab.prefer({"forced-colors": "active", "prefers-reduced-motion": "reduce"})
    shade = "getComputedStyle(document.querySelector('input[value={}]').parentElement).backgroundColor"
    assert tab.evaluate(shade.format("compensator")) != tab.evaluate(shade.format("clip"))
    assert tab.evaluate("explorer.colors.ink") == "CanvasText"
    assert tab.evaluate("getComputedStyle(document.getElementById('reset')).transitionDuration") == "0s"


@pytest.mark.parametrize("width", [320, 390])
def test_a_phone_shows_it_all(browser: Browser, paper: Shown, width: int) -> None:
    """No scrolling to the side; targets for a finger; the plot in sight while a slider is moved."""
    tab = opened(browser, paper.address, width=width, height=844, phone=True)
    tab.evaluate("probe.unfold()")
    tab.frame()
    assert tab.evaluate("document.documentElement.scrollWidth") == width
    sizes = tab.evaluate("probe.targets()")
    assert len(sizes) > 50
    least = {name: TARGET if " back to " in name else FINGER for name in sizes}
    assert {name: size for name, size in sizes.items() if min(size) < least[name]} == {}
    wide, high = tab.evaluate("(p => [p.box.w, p.box.h])(explorer.panels[0].plot)")
    assert wide > 175
    assert high > 120
    tab.evaluate("document.getElementById('row-horizon').scrollIntoView({block: 'center'})")
    tab.frame()
    _, top, _, height = tab.evaluate("probe.box('plot-output')")
    assert 0 <= top < top + height < 844 / 2
    left, top, long, height = tab.evaluate("probe.box('row-horizon')")
    x, y = left + long / 2, top + height / 2
    before = tab.evaluate("explorer.run.ise")
    tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    tab.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": x - 60, "y": y}])
    tab.frame()
    assert tab.evaluate("explorer.run.ise") != before
    tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    tab.close()


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ("model=joint-12345678&p.c1=20", "The link is for joint-12345678"),
        (
            "p.c1=x&p.nothing=1&f.toString=2&x0=1&saturation=all&horizon=-1",
            "left out: p.c1=x, p.nothing=1, f.to",
        ),
        ("%E0%A4%A&p.c1=1e999", "left out:"),
        ("<img src=x onerror=alert(1)>", "left out: <img src=x onerror=alert(1)>"),
    ],
)
def test_a_bad_link_is_refused_in_words(browser: Browser, paper: Shown, link: str, words: str) -> None:
    tab = opened(browser, f"{paper.address}#{link}")
    assert words in tab.evaluate("probe.text('notice')")
    assert tab.evaluate("toHash(explorer.data, explorer.settings)") == ""
    assert tab.evaluate("explorer.run.status") == 1
    tab.evaluate("explorer.changed()")
    assert tab.evaluate("probe.hidden('notice')")
    tab.close()


def test_settings_that_no_run_allows_are_refused_in_words(tab: Tab) -> None:
    for change, words in (
        ({"values": {"c1": 0}}, "c1 is 0; allowed: a number greater than 0"),
        ({"values": {"k1": -1}}, "leave the filters unstable"),
        ({"values": {}, "x0": [70.2, 0], "horizon": 200}, "diverged"),
        ({"controller": "sampled", "sample_time": 1000}, "the sample time exceeds the horizon"),
    ):
        tab.evaluate(f"Object.assign(explorer.settings, {json.dumps(change)}), explorer.update()")
        assert words in tab.evaluate("probe.text('alert')")
        assert not tab.evaluate("probe.hidden('alert')")


@pytest.mark.parametrize("box", ["", 'sandbox="allow-scripts"'])
def test_it_runs_in_a_frame(browser: Browser, paper: Shown, tmp_path: Path, box: str) -> None:
    """On a page and in a sandbox, from disk: an address and a clipboard that it may not use do no harm."""
    around = tmp_path / "around.html"
    heard = "<script>onmessage = (event) => { document.documentElement.dataset.ready = event.data; }</script>"
    around.write_text(f'{heard}<iframe {box} width="900" height="700" src="inner.html"></iframe>')
    (tmp_path / "inner.html").write_text(paper.page.html.replace("</body>", INSIDE), encoding="utf-8")
    tab = browser.open(around.as_uri(), width=1000, height=800)
    assert tab.evaluate("document.documentElement.dataset.ready") == "run 1"
    tab.close()
