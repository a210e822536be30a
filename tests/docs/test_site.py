"""The site: it builds without a warning, loads nothing from a network, and its search works from disk."""

from __future__ import annotations

import html
import json
import logging
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import griffe
import pytest
from markdown import Markdown
from mkdocs.commands.build import build
from mkdocs.config import load_config

from docs.web import formulas, keywords, links, mathematics, notebook, pages
from pmjoint_codegen.dossier.browser import QUIET

BROWSER = shutil.which("chromium")
LOADS = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src"}
STUB = "<!doctype html><title>explorer</title>"


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site, with stubs for what takes long: `make site` makes that, and it has its own tests."""
    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        patch.setattr(pages, "explorer", lambda: STUB)
        patch.setattr(pages, "report", lambda: STUB)
        patch.setattr(notebook, "executed", lambda script: (f"# {script.stem}\n", {}))
        config = load_config(str(root / "mkdocs.yml"), site_dir=str(folder))
        config.plugins.on_startup(command="build", dirty=False)
        build(config)
    logging.getLogger("mkdocs").handlers.clear()
    return folder


class Resources(HTMLParser):
    """What a page loads, and the addresses of its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        value = dict(attrs).get(LOADS.get(tag, ""))
        if value:
            self.loaded.append(value)


def test_every_page_loads_files_of_the_site_alone(site: Path) -> None:
    found = sorted(site.rglob("*.html"))
    assert len(found) > 40
    for page in found:
        for resource in Resources(page.read_text(encoding="utf-8")).loaded:
            assert not re.match(r"(?:https?:)?//", resource), f"{page.name}: {resource}"
            if page.name != "404.html":  # which a server delivers, for any address
                assert (page.parent / resource.partition("?")[0]).exists(), f"{page.name}: {resource}"
    for style in site.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", style.read_text(encoding="utf-8"))


def test_each_source_is_a_page_only_where_a_page_links_it(site: Path) -> None:
    assert {file.name for file in (site / "howto").glob("*.py*")} == {"bench.py.html", "rig.py.html"}
    assert list(site.rglob("*.py")) == list(site.glob("*.py.html")) == []
    assert 'class="highlight"' in (site / "models" / "gallery" / "tclab.toml.html").read_text(
        encoding="utf-8"
    )
    assert 'href="models/gallery/tclab.toml.html"' in (site / "gallery.html").read_text(encoding="utf-8")


def test_formulas_are_drawn_and_none_is_left_as_text(site: Path) -> None:
    for page in ("derivations/joint-damped.html", "audit.html"):
        text = (site / page).read_text(encoding="utf-8")
        assert text.count("<math") > 50
        assert "<mtable" in text
        assert not re.search(r"\\(?:frac|dot|begin)|\$`", text)
    assert '<div class="formula"' in (site / "theory.html").read_text(encoding="utf-8")


def test_the_front_page_holds_the_explorer(site: Path) -> None:
    assert '<iframe class="explorer"' in (site / "index.html").read_text(encoding="utf-8")
    assert (site / pages.EXPLORER).read_text(encoding="utf-8") == STUB
    assert f'href="{pages.REPORT}"' in (site / "report.html").read_text(encoding="utf-8")


def test_the_reference_documents_every_public_name(site: Path) -> None:
    text = "".join(file.read_text(encoding="utf-8") for file in (site / pages.REFERENCE).glob("*.html"))
    documented = set(re.findall(r'id="([\w.]+)" class="doc doc-heading"', text))
    assert documented >= set(pages.public_names())
    assert 'href="errors.html#pmjoint_codegen.errors.UsageError"' in text
    simulate = text[text.index('id="pmjoint_codegen.closed_loop.ClosedLoop.simulate"') :]
    assert simulate.index("<b>horizon</b>" if "<b>horizon</b>" in simulate else "horizon") < simulate.index(
        "Raises:"
    )


FLAGS = (*QUIET, "--no-sandbox", "--virtual-time-budget=20000", "--dump-dom")
# The browser refuses what is not a file, and says so: the last request shows that it would.
POLICY = "default-src file: data: blob: 'unsafe-inline' 'unsafe-eval'"
BEFORE = f"""<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<script>
const refused = [];
addEventListener("securitypolicyviolation", (event) => refused.push(event.blockedURI));
</script>"""
AFTER = """<script>
addEventListener("load", () => setTimeout(async () => {
  const field = document.querySelector("input.md-search__input");
  field.focus();
  field.value = "Filippov";
  field.dispatchEvent(new KeyboardEvent("keyup", {key: "v", bubbles: true}));
  for (let i = 0; i < 100 && !document.querySelector("a.md-search-result__link"); i += 1)
    await new Promise((go) => setTimeout(go, 50));
  await fetch("https://example.org/asked").catch(() => {});
  await new Promise((go) => setTimeout(go, 50));
  const pre = document.createElement("pre");
  pre.id = "found";
  const results = [...document.querySelectorAll("a.md-search-result__link")].map((link) => link.href);
  pre.textContent = JSON.stringify({results, refused});
  document.body.append(pre);
}, 200));
</script>"""


@pytest.mark.skipif(BROWSER is None, reason="chromium is not installed")
def test_the_search_works_from_disk_and_nothing_asks_a_network(site: Path, tmp_path: Path) -> None:
    page = site / "probe.html"
    text = (site / "index.html").read_text(encoding="utf-8")
    text = text.replace("<head>", f"<head>{BEFORE}", 1).replace("</body>", f"{AFTER}</body>", 1)
    page.write_text(text, encoding="utf-8")
    command = [str(BROWSER), *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    page.unlink()
    left = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert left is not None, done.stderr[-2000:]
    found = json.loads(html.unescape(left[1]))
    assert [address for address in found["results"] if "theory.html" in address]
    assert found["refused"] == ["https://example.org/asked"]


def test_a_link_follows_the_file_that_it_names() -> None:
    held = {
        "models/a.toml": "models/a.toml.md",
        "docs/theory.md": "theory.md",
        "CHANGELOG.md": "changelog.md",
    }
    text = "[a](../models/a.toml) [b](theory.md#x) [c](https://e.org/theory.md) [d](lost.md) [e](#here)"
    assert links.rewritten(text, "docs/gallery.md", "gallery.md", held) == (
        "[a](models/a.toml.md) [b](theory.md#x) [c](https://e.org/theory.md) [d](lost.md) [e](#here)"
    )
    assert links.rewritten("[a](docs/theory.md)", "README.md", "deep/readme.md", held) == "[a](../theory.md)"
    named = "[theory.md](theory.md) and [how/to-do.md](how/to-do.md)"
    assert links.rewritten(named, "docs/a.md", "a.md", {}) == "[theory](theory.md) and [to-do](how/to-do.md)"
    assert list(links.linked("docs/gallery.md", text)) == ["models/a.toml", "docs/theory.md", "docs/lost.md"]


def test_an_address_of_each_kind_of_file() -> None:
    assert pages.address("docs/howto/rig.py") == "howto/rig.py.md"
    assert pages.address("docs/theory.md") == "theory.md"
    assert pages.address("generated/paper/derivation.md") == "derivations/paper.md"
    assert pages.address("docs/figures/tune.png") == "figures/tune.png"
    assert pages.address("docs/notebooks/first-steps.py") == "notebooks/first-steps.md"
    assert pages.address("README.md") is None


def test_formulas_in_a_line_and_in_a_block() -> None:
    drawn = Markdown(extensions=["docs.web.mathematics", "tables"]).convert(
        "| a |\n|---|\n| $`x_1 < 2`$ `y` |"
    )
    assert "<msub><mi>x</mi><mn>1</mn></msub>" in drawn and "&#x0003C;" in drawn and "<code>y</code>" in drawn
    rows = mathematics.block(
        "\\begin{aligned}a ={}& b\\\\ & + c\\end{aligned}", "math", "math", {}, Markdown()
    )
    assert rows.count("<mtr>") == 2 and ">&<" not in rows


def test_a_notebook_is_executed(tmp_path: Path) -> None:
    script = tmp_path / "steps.py"
    script.write_text(
        "# %% [markdown]\n# # Steps\n\n# %%\nprint(6 * 7)\n\n"
        "# %%\nimport matplotlib.pyplot as plt\nplt.plot([1, 2]);\n",
        encoding="utf-8",
    )
    text, figures = notebook.executed(script)
    ((name, picture),) = figures.items()
    assert "# Steps" in text and "\n    42\n" in text and f"({name})" in text
    assert picture.startswith(b"\x89PNG") and name.startswith("steps-figures/")


def test_indices_and_powers_of_plain_formulas_move_and_names_stay() -> None:
    text = "y_r, g_i(θ), e_1ᵀ, ẋ_i, x_{i+1} and 1/s^2, y^(n−1), but output_step, to_control, `c_1` and *x*_"
    drawn = Markdown(extensions=["docs.web.formulas"]).convert(text)
    assert "y<sub>r</sub>, g<sub>i</sub>(θ), e<sub>1</sub>ᵀ, ẋ<sub>i</sub>, x<sub>i+1</sub> and" in drawn
    assert "1/s<sup>2</sup>, y<sup>(n−1)</sup>, but output_step, to_control, <code>c_1</code>" in drawn
    rows = formulas.block("a < b_max   c^{A T}\n", "formula", "formula", {}, Markdown())
    assert "<span><i>a</i> &lt; <i>b</i><sub>max</sub></span>" in rows
    assert "<span><i>c</i><sup><i>A</i> <i>T</i></sup></span>" in rows


def test_keywords_are_shown_as_parameters(tmp_path: Path) -> None:
    (tmp_path / "made.py").write_text(
        "from typing import TypedDict, Unpack\n"
        "class Base(TypedDict, total=False):\n    a: int\n"
        "class More(Base, total=False):\n    b: str\n"
        "def f(x, **asked: Unpack[More]): ...\n"
        'def g(**asked: Unpack[More]):\n    """Do.\n\n    Args:\n        asked: as for f.\n    """\n',
        encoding="utf-8",
    )
    loaded = griffe.load("made", search_paths=[tmp_path], extensions=griffe.Extensions(keywords.Keywords()))
    assert [parameter.name for parameter in loaded["f"].parameters] == ["x", "a", "b"]
    assert [parameter.name for parameter in loaded["g"].parameters] == ["asked"]
