"""docs/howto/put-the-controller-on-a-microcontroller.md: its commands run, and its C compiles and steps."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "howto" / "put-the-controller-on-a-microcontroller.md").read_text(encoding="utf-8")
WARNINGS = (
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Werror",
    "-Wno-missing-prototypes",
)
USE = """
#include <stdio.h>
int start(double y, double y_r);
double every_two_milliseconds(double y, double y_r, double measured_u);
int main(void)
{
    double u = 0.0;
    if (start(0.1, 0.0) != 0) {
        return 1;
    }
    for (int k = 0; k < 5; ++k) {
        u = every_two_milliseconds(0.1, 0.0, u);
    }
    printf("%g\\n", u);
    return 0;
}
"""


def test_the_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    commands = [line.strip() for line in PAGE.splitlines() if line.startswith("    pmjoint ")]
    assert len(commands) == 3
    for command in commands:
        assert run(shlex.split(command)[1:]) == 0
        if shutil.which("make") and shutil.which("cc"):
            done = subprocess.run(
                ["make", "-C", "controller", "clean", "test"], capture_output=True, check=False
            )
            assert done.returncode == 0, done.stderr


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_code_compiles_and_steps(tmp_path: Path) -> None:
    assert run(["export", "paper", "--target", "c", "--out", str(tmp_path)]) == 0
    (code,) = re.findall(r"^```c\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    (tmp_path / "use.c").write_text(code + USE, encoding="utf-8")
    build = ["cc", *WARNINGS, "use.c", "pmjoint_paper.c", "-o", "use", "-lm"]
    subprocess.run(build, cwd=tmp_path, check=True)
    done = subprocess.run(["./use"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert -10.0 <= float(done.stdout) <= 10.0 and float(done.stdout) != 0.0
