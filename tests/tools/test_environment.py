"""When `.venv` is reused, when it is made anew, and that pip is never asked for what it cannot do."""

from __future__ import annotations

import importlib.util
import pwd
from pathlib import Path
from types import ModuleType

import pytest

LOCKS = ("installer", "simulate", "dev")


@pytest.fixture
def environment(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Load tools/environment.py on an empty project of its own, whose pip and venv only leave a record."""
    spec = importlib.util.spec_from_file_location("environment", root / "tools" / "environment.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (tmp_path / "requirements").mkdir()
    (tmp_path / "derive").mkdir()
    for name in ("pyproject.toml", *(f"requirements/{name}.txt" for name in LOCKS)):
        (tmp_path / name).write_text("1", encoding="utf-8")
    record = tmp_path / "record"

    def create() -> None:
        (tmp_path / ".venv").mkdir(exist_ok=True)
        for old in (tmp_path / ".venv").iterdir():
            old.unlink()
        note("venv")

    def note(*words: str) -> None:
        with record.open("a", encoding="utf-8") as file:
            file.write(" ".join(words) + "\n")

    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(module, "create", create)
    monkeypatch.setattr(module, "pip_install", note)
    return module


INSTALLER = "--require-hashes --no-deps -r requirements/installer.txt"
WHEELS = "--require-hashes --only-binary :all: -r"
SIMULATE = f"{WHEELS} requirements/simulate.txt"
DEV = f"{WHEELS} requirements/dev.txt"
PROJECT = "--no-deps --no-build-isolation --editable ."


def done(environment: ModuleType, *locks: str) -> list[str]:
    """Ask for locks and return what was run for them."""
    record: Path = environment.ROOT / "record"
    record.write_text("", encoding="utf-8")
    environment.main(locks)
    return record.read_text(encoding="utf-8").splitlines()


def test_second_call_does_nothing(environment: ModuleType) -> None:
    assert done(environment, "simulate") == ["venv", INSTALLER, SIMULATE, PROJECT]
    assert done(environment, "simulate") == []


def test_later_lock_adds_to_what_is_there(environment: ModuleType) -> None:
    done(environment, "simulate")
    assert done(environment, "simulate", "dev") == [DEV]
    assert done(environment, "simulate") == []


@pytest.mark.parametrize("lock", LOCKS)
def test_changed_lock_rebuilds_from_nothing(environment: ModuleType, lock: str) -> None:
    done(environment, "simulate", "dev")
    (environment.ROOT / "requirements" / f"{lock}.txt").write_text("2", encoding="utf-8")
    assert done(environment, "simulate", "dev") == ["venv", INSTALLER, SIMULATE, DEV, PROJECT]


def test_changed_interpreter_rebuilds_from_nothing(
    environment: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    done(environment, "simulate")
    monkeypatch.setattr(environment, "PYTHON", "another")
    assert done(environment, "simulate") == ["venv", INSTALLER, SIMULATE, PROJECT]


def test_changed_project_file_installs_the_project_alone(environment: ModuleType) -> None:
    done(environment, "simulate")
    (environment.ROOT / "pyproject.toml").write_text("2", encoding="utf-8")
    assert done(environment, "simulate") == [PROJECT]


def test_interrupted_installation_is_begun_again(
    environment: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_words: str) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(environment, "pip_install", interrupted)
        with pytest.raises(KeyboardInterrupt):
            environment.main(["simulate"])
    assert done(environment, "simulate") == ["venv", INSTALLER, SIMULATE, PROJECT]


def test_a_checkout_that_cannot_be_written_is_said_to_be_so(
    environment: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment.os, "access", lambda *_arguments: False)
    with pytest.raises(SystemExit, match=r"cannot be written.*clone it into a folder of your own"):
        done(environment, "simulate")
    assert not (environment.ROOT / ".venv").exists()


def test_a_whole_environment_in_a_checkout_that_cannot_be_written_is_used(
    environment: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    done(environment, "simulate")
    monkeypatch.setattr(environment.os, "access", lambda *_arguments: False)
    assert done(environment, "simulate") == []


def test_an_archive_without_links_gets_the_one_that_imports_need(environment: ModuleType) -> None:
    done(environment, "simulate")
    assert (environment.ROOT / "pmjoint_derive").readlink() == Path("derive")


def test_pip_has_no_cache_without_a_home(environment: ModuleType, tmp_path: Path) -> None:
    assert "PIP_NO_CACHE_DIR" in environment.pip_environment({"HOME": str(tmp_path / "nowhere")})
    assert "PIP_NO_CACHE_DIR" not in environment.pip_environment({"HOME": str(tmp_path)})


@pytest.mark.parametrize("env", [{}, {"HOME": ""}], ids=["no HOME", "empty HOME"])
def test_a_user_whom_the_system_does_not_know_has_no_cache(
    environment: ModuleType, monkeypatch: pytest.MonkeyPatch, env: dict[str, str]
) -> None:
    def unknown(_uid: int) -> None:
        raise KeyError("uid not found")

    monkeypatch.delenv("HOME")
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    assert environment.pip_environment(env)["PIP_NO_CACHE_DIR"] == "1"


def test_what_the_user_tells_pip_stays(environment: ModuleType) -> None:
    told = {
        "PIP_INDEX_URL": "file:///mirror",
        "PIP_PROXY": "proxy:1",
        "PIP_CERT": "/ca",
        "PIP_FIND_LINKS": "/x",
    }
    assert told.items() <= environment.pip_environment({**told, "HOME": "/"}).items()
    assert environment.pip_environment({"PIP_USER": "1", "HOME": "/"})["PIP_USER"] == "0"
