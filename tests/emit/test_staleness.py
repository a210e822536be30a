"""Every single change, of a model file, of the derivation or of a generated file, gets its verdict."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.emit.pipeline import Artifacts
from pmjoint_codegen.emit.regenerate import regenerate
from pmjoint_codegen.emit.staleness import REMEDIES, Verdict, compare
from pmjoint_codegen.identity import model_hash
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.storage import replace_folder, sha256
from pmjoint_derive import Design, backstepping
from pmjoint_derive.compensator import compensator_rates

ROOT = Path(__file__).resolve().parents[2]
MODELS = sorted((ROOT / "models").glob("*.toml"))


@pytest.fixture
def project(tmp_path: Path, artifacts: Artifacts, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a project that holds the paper's model, generated and current; stand in it."""
    (tmp_path / "models").mkdir()
    shutil.copy(ROOT / "models" / "paper.toml", tmp_path / "models")
    folder = tmp_path / "generated" / "paper"
    folder.mkdir(parents=True)
    for name, text in artifacts.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def command(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run pmjoint from the sources in a folder, or the installed ones where there are none."""
    line = [sys.executable, "-m", "pmjoint_codegen", *arguments]
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)


def edit(project: Path, old: str, new: str) -> None:
    """Change the project's model file at one place."""
    path = project / "models" / "paper.toml"
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, old
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_what_is_current_is_left_alone(project: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in project.rglob("*")}
    (report,) = regenerate(())
    assert (report.comparison.verdict, report.written) == (Verdict.CURRENT, False)
    assert {path: path.stat().st_mtime_ns for path in project.rglob("*")} == before


def test_comments_and_layout_are_no_change(project: Path) -> None:
    edit(project, "[actuator]", "# a comment\n\n[actuator]  # another")
    assert regenerate((), check=True)[0].comparison.verdict is Verdict.CURRENT


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("value = 0.2,", "value = 0.3,", ("    d1: 0.2 -> 0.3",)),
        ("c  = [15, 15]", "c  = [15, 16]", ("    c2: 15.0 -> 16.0",)),
        (
            '[["0"], ["y"]]',
            '[["0"], ["-y"]]',
            ("    - Xi21_dot = -Xi11*k2 + y", "    + Xi21_dot = -Xi11*k2 - y"),
        ),
        (
            '"sin(t)"',
            '"cos(t)"',
            ("    - y_r = sin(t)", "    + dy_r = -sin(t)", " reference: sin(t) -> cos(t)"),
        ),
        ('sigma = "1"', 'sigma = "1 + y**2"', ("    + lambda2_dot = -k2*lambda1 + u*(y**2 + 1)",)),
        ('b     = ["b0"]', 'b     = ["2*b0"]', ("    + b_0 = 2*b0", "    + z2 = ")),
        ("x0          = [1.5, 0.0]", "x0 = [1.4, 0.0]", ("    x0: [1.5, 0.0] -> [1.4, 0.0]",)),
        ("disturbance_bound = 0.1 ", "disturbance_bound = 0.2 ", ("D_max: 0.1 -> 0.2",)),
        (
            'title  = "Pneu',
            'title  = "A pneu',
            (" title: Pneumatic muscle joint, Cai et al. 2020 -> A",),
        ),
    ],
    ids=lambda value: value[:20] if isinstance(value, str) else "",
)
def test_a_changed_model_is_told_in_mathematics(
    project: Path, old: str, new: str, told: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    edit(project, old, new)
    assert run(["regenerate", "--check"]) == 1
    said = capsys.readouterr().out
    assert said.startswith("paper  model changed\n")
    assert said.endswith("    to fix it: pmjoint regenerate paper\n")
    for line in told:
        assert line in said


def test_what_changed_is_written_and_then_current(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(project, "value = 0.2,", "value = 0.3,")
    assert run(["regenerate"]) == 0
    assert capsys.readouterr().out == (
        "paper  model changed  written to generated/paper\n    d1: 0.2 -> 0.3\n"
    )
    assert run(["regenerate", "--check"]) == 0
    assert capsys.readouterr().out == "paper  current\n"


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every value in a document."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(inner, (*path, key))
    else:
        yield path


def mutated(value: Any) -> Any:
    """Return the least change of a value."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1 if value == 0 else value * (1 + 2**-52)
    return f"-({value})"


@pytest.mark.parametrize("model", MODELS, ids=[path.stem for path in MODELS])
def test_no_change_of_a_model_file_goes_unseen(model: Path) -> None:
    """Each single entry, changed in its last digit, is another model."""
    document = read_document(model)
    paths = list(leaves(document))
    assert len(paths) > 30
    seen = {model_hash(document)}
    for path in paths:
        changed = deepcopy(document)
        table = changed
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = mutated(table[path[-1]])
        seen.add(model_hash(changed))
    assert len(seen) == len(paths) + 1


@pytest.mark.parametrize(
    "name", ["derivation.md", "equations.json", "kernels.c", "kernels.h", "kernels.tape", "model.json"]
)
def test_one_byte_in_a_generated_file_is_an_edit(artifacts: Artifacts, name: str) -> None:
    """Changed, lost or added, anywhere in the file."""
    standing = {file: text.encode() for file, text in artifacts.files.items()}
    assert compare(standing, artifacts.files, artifacts.manifest).verdict is Verdict.CURRENT
    generator, data = random.Random(name), standing[name]
    for place in [0, len(data) - 1, *(generator.randrange(len(data)) for _ in range(40))]:
        flipped = bytes([data[place] ^ (1 << generator.randrange(8))])
        for byte in (flipped, b"", data[place : place + 1] + b" "):
            edited = {**standing, name: data[:place] + byte + data[place + 1 :]}
            found = compare(edited, artifacts.files, artifacts.manifest)
            assert found.verdict is Verdict.EDITED, (place, byte)
            assert name in found.details[0]


def test_an_edited_file_is_told_with_its_remedy_and_mended(
    project: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = project / "generated" / "paper" / "kernels.c"
    good = path.read_bytes()
    path.write_bytes(good.replace(b"+", b"-", 1))
    assert run(["regenerate", "--check"]) == 1
    assert capsys.readouterr().out == (
        "paper  edited by hand\n    kernels.c was edited by hand\n"
        "    to fix it: edit the model file, not generated/; then pmjoint regenerate paper\n"
    )
    assert run(["regenerate"]) == 0
    assert path.read_bytes() == good


def test_missing_surplus_and_orphans_count(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = project / "generated" / "paper"
    (folder / "kernels.h").unlink()
    (folder / "notes.txt").write_text("mine")
    (report,) = regenerate((), check=True)
    assert report.comparison.verdict is Verdict.EDITED
    assert report.comparison.details == ("kernels.h is missing", "notes.txt does not belong here")
    folder.rename(folder.with_name("lost"))
    assert run(["regenerate", "--check"]) == 1
    assert capsys.readouterr().out == (
        "paper  missing\n    nothing is generated yet\n    to fix it: pmjoint regenerate paper\n"
        "lost   orphan\n    no model file has this name\n"
        "    to fix it: delete the folder, or restore models/lost.toml\n"
    )


def test_every_verdict_but_current_has_a_remedy() -> None:
    assert {verdict for verdict in Verdict if not REMEDIES[verdict]} == {Verdict.CURRENT}


SLIPS = [  # file, what stands there, what a slip would make of it, an equation that then differs
    ("derive/filters.py", "shift_matrix(n) - gain", "shift_matrix(n) + gain", "xi1_dot"),
    ("derive/compensator_matrix.py", "-signals.ck[i] if", "signals.ck[i] if", "r1_dot"),
    ("derive/closed_loop.py", "+ sp.Matrix(disturbance_symbols", "- sp.Matrix(disturbance_symbols", "x2_dot"),
    ("derive/backstepping.py", "s.y - s.y_r[0] - s.r[0]", "s.y - s.y_r[0] + s.r[0]", "z1"),
    (
        "derive/backstepping.py",
        "rate = -(s.c[i - 1] + weight * s.e",
        "rate = -(s.c[i - 1] - weight * s.e",
        "v",
    ),
    ("derive/hold.py", "F * sp.Matrix(states) + G", "F * sp.Matrix(states) - G", "xi1_next"),
    ("pmjoint_codegen/emit/taylor.py", "rate[k - 1].times(1 / k)", "rate[k - 1].times(2 / k)", None),
    ("pmjoint_codegen/emit/pipeline.py", "TAYLOR_ORDER = 16", "TAYLOR_ORDER = 15", None),
]


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the sources with the paper's model and what is generated from it."""
    folder = tmp_path_factory.mktemp("sources")
    for name in ("derive", "pmjoint_codegen", "generated/paper"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "pmjoint_derive").symlink_to("derive")
    (folder / "models").mkdir()
    shutil.copy(ROOT / "models" / "paper.toml", folder / "models")
    return folder


def test_the_copied_sources_say_current(sources: Path) -> None:
    assert command(sources, "regenerate", "--check").stdout == "paper  current\n"


@pytest.mark.parametrize(
    ("file", "old", "new", "equation"), SLIPS, ids=[f"{Path(file).stem}: {new}" for file, _, new, _ in SLIPS]
)
def test_a_slip_in_the_sources_is_a_changed_generator(
    sources: Path, file: str, old: str, new: str, equation: str | None
) -> None:
    path = sources / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    try:
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        done = command(sources, "regenerate", "--check")
    finally:
        path.write_text(text, encoding="utf-8")
    assert done.returncode == 1, done.stderr
    assert done.stdout.startswith("paper  generator changed\n")
    assert "kernels.tape has other content" in done.stdout
    assert done.stdout.endswith("    to fix it: pmjoint regenerate paper, and review what changed\n")
    if equation is not None:
        before, after = (
            re.search(rf"^    {sign} {equation} = .*$", done.stdout, re.M) for sign in (r"-", r"\+")
        )
        assert before and after and before[0][6:] != after[0][6:]


def test_a_derivation_that_fails_is_a_changed_generator_too(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A slip may leave u in the law, which the derivation itself finds out."""

    def slipped(design: Design) -> dict[sp.Symbol, sp.Expr]:
        du = design.signals.du
        return {state: rate.subs(du, -du) for state, rate in compensator_rates(design).items()}

    monkeypatch.setattr(backstepping, "compensator_rates", slipped)
    assert run(["regenerate", "--check"]) == 1
    why = "the derivation fails: step 2: v would depend on [u]"
    assert capsys.readouterr().out.startswith(f"paper  generator changed\n    {why}\n")


REPLACE_FOREVER = """
import sys
from pathlib import Path
from pmjoint_codegen.storage import replace_folder, sha256
folder, *versions = map(Path, sys.argv[1:])
contents = [{path.name: path.read_bytes() for path in version.iterdir()} for version in versions]
print("ready", flush=True)
while True:
    for files in contents:
        replace_folder(folder, files)
"""


def test_a_kill_at_any_moment_leaves_the_old_or_the_new(project: Path, artifacts: Artifacts) -> None:
    """SIGKILL while the folder is replaced over and over: what stands there is one version, whole."""
    folder = project / "generated" / "paper"
    old = {name: text.encode() for name, text in artifacts.files.items()}
    new = {name: text.upper() for name, text in old.items()}
    for name, version in {"old": old, "new": new}.items():
        (project / name).mkdir()
        for file, data in version.items():
            (project / name / file).write_bytes(data)
    generator = random.Random(1)
    for _ in range(8):
        folders = [str(path) for path in (folder, project / "old", project / "new")]
        line = [sys.executable, "-c", REPLACE_FOREVER, *folders]
        process = subprocess.Popen(line, stdout=subprocess.PIPE, env=os.environ)
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(generator.uniform(0.0, 0.2))
        process.kill()
        process.wait()
        process.stdout.close()
        if folder.exists():  # not so for a moment between two renames
            assert {path.name: path.read_bytes() for path in folder.iterdir()} in (old, new)
    replace_folder(folder, new)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == new
    assert list(folder.parent.iterdir()) == [folder]  # what killed runs staged is swept away


def test_a_manifest_with_other_fields_is_the_generator_s_doing(artifacts: Artifacts) -> None:
    """A field that this version does not know, in a file whose hash is right, was not typed in by hand."""
    contents = json.loads(artifacts.files["model.json"])
    contents.pop("kinks")
    text = json.dumps({**contents, "contents_hash": ""}, indent=1, ensure_ascii=False) + "\n"
    older = text.replace('"contents_hash": ""', f'"contents_hash": "{sha256(text.encode())}"')
    files = {name: body.encode() for name, body in artifacts.files.items()} | {"model.json": older.encode()}
    assert compare(files, artifacts.files, artifacts.manifest).verdict is Verdict.GENERATOR_CHANGED
