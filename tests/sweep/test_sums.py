"""Files of sums are read as what ``sha256sum`` writes, and name nothing outside their folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmjoint_codegen.sweep.sums import as_text, recorded

DIGEST = "0" * 64


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    sums = {"c/0.0": DIGEST, "zarr.json": "a" * 64}
    (tmp_path / "sums").write_text(as_text(sums), encoding="utf-8")
    assert recorded(tmp_path / "sums") == sums


@pytest.mark.parametrize("name", ["../x", "a/../../x", "/etc/x", ""])
def test_a_name_that_leads_elsewhere_makes_it_something_else(tmp_path: Path, name: str) -> None:
    (tmp_path / "sums").write_text(f"{DIGEST}  zarr.json\n{DIGEST}  {name}\n", encoding="utf-8")
    assert recorded(tmp_path / "sums") is None
