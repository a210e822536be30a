"""A machine with an old pip gets the environment that the locks name, whatever the index serves by then."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType

import pytest

from pmjoint_codegen import __version__

# Ubuntu 22.04, Debian 12, Python 3.11.7; the first does not start under Python 3.12.
OLD = ("22.0.2", "23.0.1", "23.2.1") if sys.version_info < (3, 12) else ("23.2.1",)

pytestmark = pytest.mark.index


def quiet(command: Sequence[str | Path], cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command and keep what it says."""
    return subprocess.run(
        command, check=False, capture_output=True, text=True, cwd=cwd, stdin=subprocess.DEVNULL
    )


@pytest.fixture
def aged(root: Path, tmp_path: Path) -> Iterator[Callable[[str], ModuleType]]:
    """Yield what loads tools/environment.py of a copy of the project, on a machine that has one old pip."""
    clone = tmp_path / "a folder with spaces"
    clone.mkdir()
    listing = quiet(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], root)
    if listing.returncode:
        pytest.skip(f"not a git checkout: {listing.stderr.strip()}")
    for name in listing.stdout.split("\0"):
        if name and (root / name).is_symlink():
            (clone / name).symlink_to((root / name).readlink())
        elif name and (root / name).is_file():
            (clone / name).parent.mkdir(parents=True, exist_ok=True)
            (clone / name).write_bytes((root / name).read_bytes())

    def load(version: str) -> ModuleType:
        spec = importlib.util.spec_from_file_location("environment", clone / "tools" / "environment.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        create = module.create

        def create_aged() -> None:
            create()
            pip = [module.VENV / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "install"]
            done = quiet([*pip, "-q", "--force-reinstall", f"pip=={version}"], clone)  # asks the index always
            if done.returncode and not os.environ.get("CI"):
                pytest.skip(f"no index: {done.stderr.strip().splitlines()[-1]}")
            assert done.returncode == 0, done.stderr
            assert pip_version(module.VENV) == version

        module.create = create_aged  # type: ignore[attr-defined]
        return module

    yield load
    shutil.rmtree(clone)  # an environment is larger than what pytest should keep


def pip_version(venv: Path) -> str:
    """Return the version of the pip in an environment."""
    found = re.match(r"pip (\S+)", quiet([venv / "bin" / "python", "-m", "pip", "--version"], venv).stdout)
    assert found is not None
    return found[1]


def locked_pip(root: Path) -> str:
    """Return the version that requirements/installer.txt pins."""
    found = re.search(r"^pip==(\S+)", (root / "requirements" / "installer.txt").read_text(), re.MULTILINE)
    assert found is not None
    return found[1]


@pytest.mark.parametrize("version", OLD)
def test_an_old_pip_is_replaced_by_the_locked_one(
    root: Path, aged: Callable[[str], ModuleType], version: str
) -> None:
    environment = aged(version)
    environment.create()
    environment.replace_pip()
    assert pip_version(environment.VENV) == locked_pip(root)


def test_the_oldest_pip_gets_the_whole_test_environment(aged: Callable[[str], ModuleType]) -> None:
    environment = aged(OLD[0])
    environment.main(["simulate", "dev"])
    python, clone = environment.VENV / "bin" / "python", environment.ROOT
    assert quiet([python, "-m", "pip", "check"], clone).returncode == 0
    done = quiet(
        [python, "-m", "pytest", "-n0", "-q", "-p", "no:cacheprovider", "tests/tools/test_locks.py"], clone
    )
    assert done.returncode == 0, done.stdout + done.stderr
    done = quiet([python, "-m", "pmjoint_codegen", "--version"], clone.parent)
    assert __version__ in done.stdout, done.stderr
