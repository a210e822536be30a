"""What keeps the locks from rotting: exact pins, a hash for each, and the extras that packages ask for."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from itertools import pairwise
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

NAMES = ("installer", "simulate", "dev", "bench")


@dataclass(frozen=True)
class Lock:
    """The requirements of one lock that count for this interpreter, and the lines that are no pinned ones."""

    pins: dict[str, Requirement]
    loose: list[str]


def parse(text: str) -> Lock:
    """Read a lock: one requirement a logical line, each with exact version and hashes."""
    pins: dict[str, Requirement] = {}
    loose: list[str] = []
    uncommented = re.sub(r"^\s*#.*$", "", text, flags=re.MULTILINE)
    for line in filter(str.strip, uncommented.replace("\\\n", " ").splitlines()):
        named, *hashes = re.split(r"\s+--hash=", line.strip())
        if not hashes or not all(re.fullmatch("sha256:[0-9a-f]{64}", digest) for digest in hashes):
            loose.append(line)
            continue
        pin = Requirement(named)
        if not re.fullmatch(r"==[^*,]+", str(pin.specifier)):
            loose.append(line)
        if pin.marker is None or pin.marker.evaluate():
            pins[canonicalize_name(pin.name)] = pin
    return Lock(pins, loose)


def wanted(requirements: list[str], extras: set[str]) -> Iterator[Requirement]:
    """Yield the requirements that count for this interpreter and these extras."""
    for requirement in map(Requirement, requirements):
        contexts = [{"extra": extra} for extra in extras or {""}]
        if requirement.marker is None or any(map(requirement.marker.evaluate, contexts)):
            yield requirement


def missing(lock: Lock) -> list[str]:
    """Describe what installed packages of a lock require and the lock does not name as they do."""
    found = []
    for name, pin in lock.pins.items():
        try:
            requires = metadata.requires(name) or []
        except metadata.PackageNotFoundError:  # `make bench` alone installs some
            continue
        for needed in wanted(requires, {"", *pin.extras}):
            held = lock.pins.get(canonicalize_name(needed.name))
            if held is None or not needed.extras <= held.extras:
                found.append(f"{name} requires {needed}, and the lock holds {held}")
    return found


@pytest.fixture(params=NAMES)
def lock(root: Path, request: pytest.FixtureRequest) -> Lock:
    """Read one lock of the project."""
    return parse((root / "requirements" / f"{request.param}.txt").read_text(encoding="utf-8"))


def test_every_line_is_an_exact_pin_with_hashes(lock: Lock) -> None:
    assert lock.pins
    assert lock.loose == []


def test_every_requirement_of_a_locked_package_is_locked_with_its_extras(lock: Lock) -> None:
    assert missing(lock) == []


def test_the_checks_can_fail(root: Path) -> None:
    text = (root / "requirements" / "dev.txt").read_text(encoding="utf-8")
    (fault,) = missing(parse(text.replace("coverage[toml]", "coverage")))
    assert fault.startswith("pytest-cov requires coverage[toml]")
    assert any(fault.endswith("holds None") for fault in missing(parse(text.replace("numpy==", "numpi=="))))
    digest = f"--hash=sha256:{64 * '0'}"
    for line in (f"numpy>=1 {digest}", f"numpy==1.* {digest}", f"numpy @ file:///n {digest}", "numpy==1"):
        assert parse(f"{line}\n").loose == [line]
    assert parse("--index-url file:///index\n").loose == ["--index-url file:///index"]


def test_later_locks_hold_the_versions_of_earlier_ones(root: Path) -> None:
    _, *locks = (
        parse((root / "requirements" / f"{name}.txt").read_text(encoding="utf-8")).pins for name in NAMES
    )
    for earlier, later in pairwise(locks):
        assert earlier.keys() <= later.keys()
        assert [name for name in earlier if earlier[name].specifier != later[name].specifier] == []


def test_the_project_is_built_by_what_is_locked(root: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    locked = parse((root / "requirements" / "simulate.txt").read_text(encoding="utf-8")).pins
    for requirement in map(Requirement, project["build-system"]["requires"]):
        assert requirement.specifier == locked[canonicalize_name(requirement.name)].specifier


def test_commit_hooks_fetch_nothing(root: Path) -> None:
    hooks = (root / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    assert set(re.findall(r"^\s*- repo: *(.*)$", hooks, re.MULTILINE)) == {"local"}
    assert set(re.findall(r"^\s*language: *(.*)$", hooks, re.MULTILINE)) == {"system"}
