"""Which files platforms fold away in a review, as git itself reads .gitattributes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest


def git(root: Path, *arguments: str, given: str = "") -> str:
    """Return what git prints; skip where there is no repository."""
    done = subprocess.run(
        ["git", *arguments], cwd=root, input=given, capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.skip(f"not a git checkout: {done.stderr.strip()}")
    return done.stdout


def test_of_the_generated_files_a_review_shows_the_derivation_alone(root: Path) -> None:
    files = git(root, "ls-files", "-z", "--cached", "--others", "--exclude-standard", "generated")
    names = files.split("\0")[:-1]
    words = git(root, "check-attr", "-z", "--stdin", "linguist-generated", "diff", given=files).split("\0")
    found: dict[str, dict[str, str]] = {}
    for path, attribute, value in zip(words[::3], words[1::3], words[2::3], strict=False):
        found.setdefault(path, {})[attribute] = value
    folded = {"linguist-generated": "true", "diff": "unset"}
    shown = {"linguist-generated": "false", "diff": "markdown"}
    assert found == {path: shown if Path(path).name == "derivation.md" else folded for path in names}
    pages = {Path(path).parent.name for path, values in found.items() if values == shown}
    assert pages == {file.stem for file in (root / "models").glob("*.toml")}
