"""Links of a page, from places in the repository to places in the site.

In the repository pages link files beside and above them, as GitHub and GitLab show them. In the site a page
stands under its address there, and a file that is no page becomes one (`pages.py`). So each relative link
that names a published file is rewritten. All others stay, and MkDocs rejects those that lead nowhere.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator, Mapping

_NAMED = re.compile(r"\[(?:[\w-]+/)*([\w-]+)\.md\](?=\()")
_LINK = re.compile(r"(?P<open>\]\()(?P<path>[^()\s#:]+)(?P<anchor>#[^()\s]*)?(?=\))")


def resolved(page: str, link: str) -> str:
    """Path in the repository of a link on a page of the repository."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), link))


def linked(page: str, text: str) -> Iterator[str]:
    """Yield the path of each relative link of a page, as a path of the repository."""
    for match in _LINK.finditer(text):
        yield resolved(page, match["path"])


def rewritten(text: str, page: str, address: str, published: Mapping[str, str]) -> str:
    """Rewrite the links of a page. A text that is the name of a page loses its ending.

    Args:
        text: its Markdown.
        page: its path in the repository.
        address: its path under docs/, or the one that it would have there.
        published: path in the repository -> path under docs/, of all that the site holds.
    """

    def replaced(match: re.Match[str]) -> str:
        target = published.get(resolved(page, match["path"]))
        if target is None:
            return match[0]
        return (
            match["open"]
            + posixpath.relpath(target, posixpath.dirname(address) or ".")
            + (match["anchor"] or "")
        )

    return _NAMED.sub(r"[\1]", _LINK.sub(replaced, text))
