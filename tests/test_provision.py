"""Which kernels serve a changed model, and when they are derived anew."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen import provision
from pmjoint_codegen.errors import ModelError, StaleError
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


def test_c_for_sweeps_is_made_when_a_sweep_asks(tmp_path: Path) -> None:
    """A single run's folder has none; a sweep's folder serves single runs too."""

    def files(*, lanes: bool) -> set[str]:
        provided = provision.provide(
            "paper",
            reference="cos(t)",
            environment={"PMJOINT_CACHE": str(tmp_path)},
            notify=lambda line: pytest.fail(line),
            lanes=lanes,
        )
        found = {file.name for file in provided.folder.iterdir()}
        assert found == {*provided.manifest.files, "model.json"}
        return found

    single, swept = files(lanes=False), files(lanes=True)
    assert swept - single == {"lanes.c", "lanes.h"}
    assert files(lanes=False) == swept


def sources_of_text() -> list[str]:
    """Every source of ours that a process has imported once it can generate a model's files."""
    root = Path(__file__).resolve().parents[1]
    ask = (
        "import sys, pmjoint_codegen.emit.pipeline, pmjoint_codegen.modelfile\n"
        "print(*(module.__file__ for name, module in sys.modules.items() "
        "if name.startswith('pmjoint_') and module.__file__), sep='\\n')"
    )
    found = subprocess.run([sys.executable, "-c", ask], check=True, capture_output=True, text=True, cwd=root)
    folders = {"derive": "pmjoint_derive"}  # as the checkout names it
    names = (Path(file).resolve().relative_to(root).parts for file in found.stdout.splitlines())
    paths = sorted("/".join((folders.get(first, first), *rest)) for first, *rest in names)
    return [path for path in paths if not path.startswith("pmjoint_codegen/compile/")]  # imported, not asked


def test_every_source_that_shapes_generated_text_is_in_the_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tape's format stands beside its reader, a description of a gain in values.py."""
    root = Path(__file__).resolve().parents[1]
    for name in ("pmjoint_derive", "pmjoint_codegen"):
        shutil.copytree(root / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(provision, "__file__", str(tmp_path / "pmjoint_codegen" / "provision.py"))
    sources = sources_of_text()
    assert {"pmjoint_derive/filters.py", "pmjoint_codegen/kernels/tape.py"} <= set(sources)
    keys = [provision._toolchain_key()]
    for file in sources:
        with (tmp_path / file).open("a") as source:
            source.write("# another\n")
        keys.append(provision._toolchain_key())
    same = [file for file, before, after in zip(sources, keys, keys[1:], strict=False) if before == after]
    assert same == []


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


@pytest.mark.parametrize(
    ("model", "given", "line"),
    [
        ("paper", {"reference": "q*t"}, r"--reference: 'q\*t': unknown symbol 'q'; "),
        ("paper", {"reference": "sqrt(t)"}, r"--reference, derivative 1: .* no finite real value"),
        ("paper", {"disturbance": ["0", "q"]}, r"--disturbance, entry 2: 'q': unknown symbol"),
        ("paper", {"disturbance": ["0"]}, r"--disturbance: has 1 entry; allowed: 2 "),
        ("joint", {"disturbance": ["q"]}, r"--disturbance: 'q': unknown symbol"),
        ("joint", {"disturbance": ["1/t"]}, r"--disturbance: .* no finite real value"),
    ],
)
def test_a_bad_expression_is_told_of_the_option_that_gave_it(
    tmp_path: Path, model: str, given: dict[str, Any], line: str
) -> None:
    with pytest.raises(ModelError, match=f"^{line}"):
        provision.provide(
            model, **given, environment={"PMJOINT_CACHE": str(tmp_path)}, notify=lambda line: None
        )


def test_a_bad_expression_in_the_file_is_told_of_the_file(tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[1]
    text = (root / "models" / "paper.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace('"sin(t)"', '"q*t"'))
    with pytest.raises(ModelError, match=r"mine\.toml: simulation\.reference: 'q\*t'"):
        provision.provide(
            tmp_path / "mine.toml",
            disturbance=["0", "0"],
            environment={"PMJOINT_CACHE": str(tmp_path)},
            notify=lambda line: None,
        )


def test_a_number_of_a_joint_without_unit_is_told_of(tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[1]
    text = (root / "models" / "joint.toml").read_text()
    bare = re.sub(r"(?m)^r .*$", "r = { value = 15 }", re.sub(r"(?m)^J .*$", "J = 0.05", text))
    (tmp_path / "mine.toml").write_text(bare)
    lines: list[str] = []
    environment = {"PMJOINT_CACHE": str(tmp_path)}
    with pytest.raises(ModelError, match="unknown symbol"):
        provision.provide(tmp_path / "mine.toml", reference="q", environment=environment, notify=lines.append)
    assert lines == [f"{tmp_path / 'mine.toml'}: joint.r has no unit: 15 is taken in SI units"]
    (tmp_path / "mine.toml").write_text(re.sub(r"(?ms)^\[joint\].*?(?=^\[)", "joint = 3\n", text))
    with pytest.raises(ModelError, match="joint"):
        provision.provide(tmp_path / "mine.toml", environment=environment, notify=lines.append)
