"""What MkDocs calls while it builds the site: pages are added, links rewritten, the explorer set in.

mkdocs.yml names this module. `pages.py` says what is added, `links.py` how links follow.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

from docs.web import links, notebook, pages

_MARK: Final = "<!-- the explorer, in the site -->"
_REPORT_PAGE: Final = "report.md"
_FRAME: Final = (
    '<iframe class="explorer" title="The closed loop of the paper, with sliders" '
    'loading="lazy" src="{src}"></iframe>\n\n'
    "[Open it in a page of its own]({src}){{ target=_blank }}"
)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is made from other sources, and give the navigation the pages that a pattern stands for."""
    added: list[File] = []

    def add(name: str, content: str | bytes, *, inside: bool = True) -> None:
        kind = InclusionLevel.UNDEFINED if inside else InclusionLevel.NOT_IN_NAV
        added.append(File.generated(config, name, content=content, inclusion=kind))

    sources = {f"{pages.DOCS}{file.src_uri}": file.content_string for file in files.documentation_pages()}
    for path, text in pages.outside_pages():
        sources[path] = text
        add(_address(path), text)
    for script in sorted(Path(config.docs_dir).glob("notebooks/*.py")):
        text, figures = notebook.executed(script)
        sources[path := f"{pages.DOCS}notebooks/{script.name}"] = text
        add(_address(path), text)
        for name, picture in figures.items():
            add(f"notebooks/{name}", picture)
    for path in sorted({target for page, text in sources.items() for target in links.linked(page, text)}):
        shown = pages.address(path)
        if (
            shown is not None
            and path not in sources
            and shown.endswith(".md")
            and (pages.ROOT / path).is_file()
        ):
            add(shown, pages.source_page(path), inside=False)
    for name, text in pages.reference_pages():
        add(name, text)
    add(pages.EXPLORER, pages.explorer())
    add(pages.REPORT, pages.report())
    for file in added:
        files.append(file)
    config.nav = _expanded(config.nav, files)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrite the links of a page, and set the explorer into the page that has its mark."""
    here = page.file.src_uri
    if page.parent is None:  # a page beside the sections: the list at the left would hold nothing but itself
        page.meta["hide"] = ["navigation", "toc"] if page.is_homepage else ["navigation"]
    origin = {_address(path): path for path, _ in pages.outside_pages()}.get(here, f"{pages.DOCS}{here}")
    known = {path: pages.address(path) for path in links.linked(origin, markdown)}
    held = {path: name for path, name in known.items() if name is not None and files.get_file_from_path(name)}
    if here == _REPORT_PAGE:
        markdown += f"\n[The report of the paper's model]({pages.REPORT}){{ target=_blank }}\n"
    return links.rewritten(markdown, origin, here, held).replace(_MARK, _FRAME.format(src=pages.EXPLORER))


def _address(path: str) -> str:
    name = pages.address(path)
    assert name is not None
    return name


def _expanded(nav: Any, files: Files) -> Any:
    """The navigation with its patterns resolved: ``folder/*`` stands for the pages in it."""
    if isinstance(nav, list):
        return [_expanded(each, files) for each in nav]
    if isinstance(nav, dict):
        return {title: _expanded(item, files) for title, item in nav.items()}
    if isinstance(nav, str) and nav.endswith("/*"):
        return [file.src_uri for file in files.documentation_pages() if file.src_uri.startswith(nav[:-1])]
    return nav
