"""Which kernels serve a changed model, and when they are derived anew."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmjoint_codegen import provision
from pmjoint_codegen.errors import StaleError
from pmjoint_codegen.storage import sha256_file


def test_what_another_toolchain_has_derived_is_derived_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def folder() -> Path:
        return provision.provide(
            "paper",
            reference="cos(t)",
            environment={"PMJOINT_CACHE": str(tmp_path)},
            notify=lambda line: pytest.fail(line),
        ).folder

    first = folder()
    assert folder() == first
    changed = Path(provision.__file__).parent / "emit" / "taylor.py"
    monkeypatch.setattr(
        provision, "sha256_file", lambda path: "changed" if path == changed else sha256_file(path)
    )
    assert folder() != first


def test_the_remedy_for_an_edited_file_names_the_model_as_it_was_found(tmp_path: Path) -> None:
    """A model in a folder of its own is not found by its name."""
    root = Path(__file__).resolve().parents[1]
    (tmp_path / "mine.toml").write_text((root / "models" / "paper.toml").read_text())
    generated = tmp_path / "generated" / "paper"
    generated.mkdir(parents=True)
    for file in (root / "generated" / "paper").iterdir():
        (generated / file.name).write_bytes(file.read_bytes())
    (generated / "kernels.c").write_text("")
    with pytest.raises(StaleError, match=r"pmjoint regenerate .*mine\.toml"):
        provision.provide(tmp_path / "mine.toml", environment={}, notify=lambda line: None)
