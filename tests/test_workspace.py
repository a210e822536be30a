"""Where model files, generated folders and the cache are found."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

from pmjoint_codegen import workspace
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.workspace import cache_dir, find_model, generated_root, known_models, project_models


@pytest.fixture
def here(tmp_path: Path) -> Path:
    (tmp_path / "models").mkdir()
    for name in ("mine", "paper"):
        (tmp_path / "models" / f"{name}.toml").touch()
    return tmp_path


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installed package, no checkout around it, that carries one model."""
    package = tmp_path / "site-packages" / "pmjoint_codegen"
    (package / "_data" / "models").mkdir(parents=True)
    (package / "_data" / "models" / "carried.toml").touch()
    (tmp_path / "site-packages" / "models").mkdir()  # some other package's
    (tmp_path / "site-packages" / "models" / "foreign.toml").touch()
    monkeypatch.setattr(workspace, "__file__", str(package / "workspace.py"))
    return package


def test_the_current_directory_comes_first(here: Path) -> None:
    assert find_model("paper", cwd=here) == here / "models" / "paper.toml"


def test_a_checkouts_models_are_found_from_anywhere(tmp_path: Path) -> None:
    found = find_model("paper", cwd=tmp_path)
    assert found == Path(__file__).resolve().parents[1] / "models" / "paper.toml"
    assert generated_root(found) == found.parents[1] / "generated"


def test_an_installed_package_carries_its_models(installed: Path, here: Path) -> None:
    assert find_model("carried", cwd=here) == installed / "_data" / "models" / "carried.toml"
    assert generated_root(find_model("carried", cwd=here)) == installed / "_data" / "generated"
    assert known_models(here) == ("carried", "mine", "paper")


def test_models_of_a_folder_above_are_found_and_new_ones_belong_there(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "notes" / "today").mkdir(parents=True)
    assert project_models(here / "notes" / "today") == here / "models"
    assert find_model("mine", cwd=here / "notes") == here / "models" / "mine.toml"
    monkeypatch.chdir(here / "notes" / "today")
    assert project_models() == Path("../../models")
    assert generated_root(find_model("mine")).resolve() == here / "generated"
    (here / "notes" / "models").mkdir()  # empty: not a project's, unless one stands beside it
    assert project_models() == Path("../../models")
    monkeypatch.chdir(here / "notes")
    assert project_models() == Path("models")


def test_folders_that_others_may_write_to_are_no_project(here: Path) -> None:
    (here / "notes").mkdir()
    here.chmod(0o777)
    assert project_models(here / "notes") == here / "notes" / "models"


def test_hidden_files_are_no_models(here: Path, installed: Path) -> None:
    (here / "models" / ".paper.toml").touch()
    assert known_models(here) == ("carried", "mine", "paper")


def test_a_path_is_taken_as_it_is(here: Path) -> None:
    assert find_model("models/mine.toml", cwd=here) == here / "models" / "mine.toml"
    assert find_model(here / "models" / "mine.toml", cwd=Path("/")) == here / "models" / "mine.toml"


def test_paths_from_the_current_directory_stay_relative(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(here)
    assert find_model("mine") == Path("models/mine.toml")
    assert generated_root(find_model("mine")) == Path("generated")


def test_an_unknown_name_is_answered_with_the_close_one_and_with_all(here: Path, installed: Path) -> None:
    with pytest.raises(ModelError) as caught:
        find_model("papre", cwd=here)
    assert str(caught.value) == (
        "no model is called 'papre'; did you mean 'paper'? "
        "known models: carried, mine, paper, or give the path of a .toml file"
    )


def test_a_missing_file_is_answered_with_its_neighbour(here: Path) -> None:
    with pytest.raises(
        ModelError, match=r"models/min\.toml: no such model file; did you mean '.*models/mine\.toml'"
    ):
        find_model("models/min.toml", cwd=here)


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a\0b", "a\0b.toml", "x" * 10_000, "x" * 10_000 + ".toml", "/", "\udc80"]
)
def test_an_impossible_name_is_one_clear_line(name: str, here: Path) -> None:
    with pytest.raises(ModelError) as caught:
        find_model(name, cwd=here)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000


def test_generated_stands_beside_models_or_beside_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert generated_root(tmp_path / "models" / "a.toml") == tmp_path / "generated"
    assert generated_root(tmp_path / "a.toml") == tmp_path / "generated"
    (tmp_path / "models").mkdir()
    monkeypatch.chdir(tmp_path / "models")
    assert generated_root(Path("a.toml")) == tmp_path / "generated"


def test_the_cache_is_where_the_user_says(tmp_path: Path) -> None:
    own, xdg, home = tmp_path / "own", tmp_path / "xdg", tmp_path / "home"
    env = {"PMJOINT_CACHE": str(own), "XDG_CACHE_HOME": str(xdg), "HOME": str(home)}
    assert cache_dir(env) == own
    assert cache_dir({**env, "PMJOINT_CACHE": ""}) == xdg / "pmjoint"
    assert cache_dir({"HOME": str(home)}) == home / ".cache" / "pmjoint"
    assert cache_dir({"XDG_CACHE_HOME": "relative", "HOME": str(home)}) == home / ".cache" / "pmjoint"


@pytest.mark.parametrize("env", [{}, {"HOME": ""}, {"HOME": "/dev/null"}, {"PMJOINT_CACHE": "/dev/null/x"}])
def test_an_unusable_cache_is_replaced_by_a_private_one_with_one_line(
    env: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    said: list[str] = []
    found = cache_dir(env, said.append)
    assert found.parent == tmp_path
    assert found.stat().st_mode & 0o077 == 0
    assert len(said) == 1 and str(found) in said[0] and "PMJOINT_CACHE" in said[0]
    assert cache_dir(env) == found  # kept for the next run


def test_a_folder_that_others_can_write_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    planted = tmp_path / f"pmjoint-{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    found = cache_dir({})
    assert found != planted
    assert found.stat().st_mode & 0o077 == 0


def test_a_folder_of_another_user_is_not_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What we make now is another's to the user that we then claim to be."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    claimed = os.getuid() + 1
    planted = tmp_path / f"pmjoint-{claimed}"
    planted.mkdir(mode=0o700)
    monkeypatch.setattr(os, "getuid", lambda: claimed)
    assert cache_dir({}).parent == tmp_path
    assert cache_dir({}) != planted


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o1777])
def test_a_named_cache_that_others_can_write_is_not_used(
    mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    planted = tmp_path / "planted"
    planted.mkdir()
    planted.chmod(mode)
    said: list[str] = []
    found = cache_dir({"PMJOINT_CACHE": str(planted)}, said.append)
    assert found != planted and found.stat().st_mode & 0o077 == 0
    assert len(said) == 1 and "other users may write" in said[0]


@pytest.mark.parametrize(("mode", "used"), [(0o777, False), (0o775, False), (0o1777, True), (0o755, True)])
def test_a_parent_that_others_can_write_must_be_sticky(
    mode: int, used: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    parent = tmp_path / "shared"
    parent.mkdir()
    parent.chmod(mode)
    cache = parent / "cache"
    assert (cache_dir({"PMJOINT_CACHE": str(cache)}) == cache) is used


def test_new_caches_are_private_under_any_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        found = cache_dir({"PMJOINT_CACHE": str(tmp_path / "a" / "b")})
    finally:
        os.umask(before)
    assert found == tmp_path / "a" / "b"
    assert [folder.stat().st_mode & 0o777 for folder in (found, found.parent)] == [0o700, 0o700]
