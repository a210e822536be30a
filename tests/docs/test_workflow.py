"""The workflow of docs/howto: pinned, complete, and each of its commands runs in a project as users have it.

What only GitHub can run is left out: the actions, and the installation from an index. Of `pmjoint check` one
gate runs; all of them take a minute.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement

from pmjoint_codegen import __version__

ROOT = Path(__file__).resolve().parents[2]
HOWTO = ROOT / "docs" / "howto"
TEXT = (HOWTO / "workflow.yml").read_text(encoding="utf-8")
REPORT = "pmjoint-check.xml"

PMJOINT = f"""#!/bin/sh
[ "$1" = check ] && set -- "$@" --gate current
exec '{sys.executable}' -m pmjoint_codegen "$@"
"""


def steps() -> list[dict[str, Any]]:
    """Return the steps of the one job."""
    (job,) = yaml.safe_load(TEXT)["jobs"].values()
    found: list[dict[str, Any]] = job["steps"]
    return found


def script(word: str) -> str:
    """Return the one `run:` script that holds a word."""
    (found,) = (step["run"] for step in steps() if word in step.get("run", ""))
    return str(found)


def shell(text: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a script as GitHub does, with `pmjoint` on the path."""
    programs = folder.parent / "programs"
    programs.mkdir(exist_ok=True)
    (programs / "pmjoint").write_text(PMJOINT, encoding="utf-8")
    (programs / "pmjoint").chmod(0o755)
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "GITHUB_BASE_REF": "main"}
    line = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", text]
    return subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a clone of a repository that holds one model, generated, with the page's .gitattributes."""
    origin = tmp_path / "origin"
    (origin / "models").mkdir(parents=True)
    shutil.copy(ROOT / "models" / "paper.toml", origin / "models")
    shutil.copytree(ROOT / "generated" / "paper", origin / "generated" / "paper")
    page = (HOWTO / "continuous-integration.md").read_text(encoding="utf-8")
    (attributes,) = re.findall(r"<!-- \.gitattributes -->\n```\n(.*?)```", page, re.DOTALL)
    (origin / ".gitattributes").write_text(attributes, encoding="utf-8")
    made = shell(
        "git -c init.defaultBranch=main init -q && git add -A && "
        "git -c user.name=n -c user.email=n@example.org -c commit.gpgsign=false commit -qm begin && "
        "git clone -q . ../project",
        origin,
    )
    assert made.returncode == 0, made.stderr
    return tmp_path / "project"


def test_it_runs_on_pushes_and_pull_requests_and_may_only_read() -> None:
    workflow = yaml.safe_load(TEXT)
    assert workflow[True].keys() == {"push", "pull_request"}  # YAML 1.1 takes the key `on` for a boolean
    assert workflow["permissions"] == {"contents": "read"}
    (job,) = workflow["jobs"].values()
    assert job["timeout-minutes"] <= 60
    assert re.fullmatch(r"ubuntu-\d\d\.\d\d", job["runs-on"])


def test_every_action_is_pinned_to_a_commit_with_its_version_beside_it() -> None:
    used = re.findall(r"^ *(?:- )?uses: (.*)$", TEXT, re.MULTILINE)
    assert len(used) == sum("uses" in step for step in steps()) == 3
    assert [
        use for use in used if not re.fullmatch(r"actions/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", use)
    ] == []


def test_it_installs_this_version_with_extras_that_exist() -> None:
    (wanted,) = re.findall(r"pip install '(.*)'", script("pip install"))
    requirement = Requirement(wanted)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert requirement.name == project["name"]
    assert str(requirement.specifier) == f"=={__version__}"
    assert requirement.extras == {"derive"} <= project["optional-dependencies"].keys()


def test_each_command_succeeds_on_a_current_project(project: Path) -> None:
    scripts = [step["run"] for step in steps() if "pmjoint " in step.get("run", "")]
    assert len(scripts) == 3
    printed = {text: shell(text, project) for text in scripts}
    assert [done.stderr for done in printed.values() if done.returncode] == []
    assert printed[script("regenerate")].stdout == "paper  current\n"
    assert "current                 passed" in printed[script("pmjoint check")].stdout
    assert "before  generated/paper at origin/main" in printed[script("pmjoint diff")].stdout
    (kept,) = (step["with"]["path"] for step in steps() if "upload-artifact" in step.get("uses", ""))
    assert '<testsuite name="paper"' in (project / kept).read_text(encoding="utf-8")
    done = shell(f"rm {REPORT} && git status --porcelain", project)
    assert (done.returncode, done.stdout) == (0, "")


def test_a_model_that_was_changed_but_not_regenerated_fails_it(project: Path) -> None:
    model = project / "models" / "paper.toml"
    model.write_text(
        model.read_text(encoding="utf-8").replace("value = 0.2,", "value = 0.3,"), encoding="utf-8"
    )
    assert shell(script("regenerate"), project).returncode == 1
    assert shell(script("pmjoint check"), project).returncode == 1
    assert "failure" in (project / REPORT).read_text(encoding="utf-8")
    shutil.copy(model, project / "models" / "new.toml")  # which the base branch does not have
    told = shell(script("pmjoint diff"), project)
    assert told.returncode == 0, told.stderr
    assert "  d1: 0.2 -> 0.3\n" in told.stdout
    assert told.stdout.count("golden trajectory\n") == 1


def test_the_report_is_kept_also_where_a_gate_failed() -> None:
    (upload,) = (step for step in steps() if "upload-artifact" in step.get("uses", ""))
    assert upload["if"] == "${{ !cancelled() }}"
    (difference,) = (step for step in steps() if "pmjoint diff" in step.get("run", ""))
    assert difference["if"] == "${{ !cancelled() && github.event_name == 'pull_request' }}"
