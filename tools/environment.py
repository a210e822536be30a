"""Make `.venv` hold exactly what lock files name, or leave it alone if it already does.

    python3 tools/environment.py simulate [dev [bench]]

Each name stands for `requirements/<name>.txt`; a later lock adds to an earlier one. Standard library only,
since this runs before anything is installed. The pip that comes with Python may be years old, so it installs
one thing only: the pip of `requirements/installer.txt`, hash checked, which installs the rest. A lock's stamp
is written last and is named after the content of the lock, the interpreter and the place of the checkout. So
an interrupted installation is begun again, a second call costs nothing, and a changed lock, interpreter or
place rebuilds `.venv` from nothing. The project itself is installed editable, anew when pyproject.toml
changes. Two calls at once wait for each other.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

OLDEST = (3, 11)
ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = os.path.realpath(sys.executable)  # the system's own, even when `.venv` itself is activated
INSTALLER = "installer"
PROJECT = "project"


def stamp(held: str) -> Path:
    """Name the file whose presence says that `.venv` holds a lock (or the project) for this interpreter."""
    digest = hashlib.sha256(f"{sys.version}\n{PYTHON}\n{ROOT}\n".encode())
    digest.update((ROOT / ("pyproject.toml" if held == PROJECT else f"requirements/{held}.txt")).read_bytes())
    return VENV / f"holds-{held}-{digest.hexdigest()[:16]}"


def is_stale(locks: Sequence[str]) -> bool:
    """Say whether `.venv` is missing, half made, or holds an older state of one of these locks."""
    if not (stamp(INSTALLER).exists() and stamp(locks[0]).exists()):
        return True
    return any(not stamp(lock).exists() for lock in locks for _ in VENV.glob(f"holds-{lock}-*"))


def pip_environment(env: Mapping[str, str]) -> dict[str, str]:
    """Return `env` with pip never asking, and without its cache where the home folder cannot hold one.

    What the user configures stays: index, mirrors, proxies, certificates. `user = true` alone cannot, as no
    virtual environment has a user's folder.
    """
    changes = {
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "PIP_NO_INPUT": "1",
        "PIP_ROOT_USER_ACTION": "ignore",
        "PIP_USER": "0",
    }
    home = env.get("HOME") or os.path.expanduser("~")  # which stays `~` for a user without a home
    if not os.access(home, os.W_OK):
        changes["PIP_NO_CACHE_DIR"] = "1"
    return {**env, **changes}


def pip_install(*arguments: str) -> None:
    """Run the environment's own pip; its errors show, its progress and warnings do not."""
    command = [str(VENV / "bin" / "python"), "-m", "pip", "-qq", "install", *arguments]
    try:
        subprocess.run(command, check=True, cwd=ROOT, env=pip_environment(os.environ))
    except subprocess.CalledProcessError as failure:
        sys.exit(f"environment: pip failed with exit code {failure.returncode}; what it said stands above")


def demand_writable() -> None:
    """End with one line where what is missing cannot be installed, since the checkout is somebody else's."""
    for place in (ROOT, VENV):
        if place.exists() and not os.access(place, os.W_OK):
            sys.exit(
                f"environment: {place} cannot be written, and .venv belongs into the checkout; "
                "clone it into a folder of your own"
            )


def create() -> None:
    """Make an empty `.venv` in place of whatever stands there."""
    for old in VENV.glob("holds-*"):
        old.unlink()
    command = [PYTHON, "-m", "venv", "--clear", str(VENV)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        sys.stderr.write(done.stdout + done.stderr)
        sys.exit(
            "environment: python's venv module is missing or broken; on Debian: apt-get install python3-venv"
        )


def link_mathematics() -> None:
    """Make the link by which derive/ is imported, where the project came in an archive without links."""
    link = ROOT / "pmjoint_derive"
    if not link.exists():
        link.symlink_to("derive")


def replace_pip() -> None:
    """Install the locked pip by the one that came with Python, of which no more than that is asked."""
    if not stamp(INSTALLER).exists():
        pip_install("--require-hashes", "--no-deps", "-r", f"requirements/{INSTALLER}.txt")
        stamp(INSTALLER).touch()


def fill(locks: Sequence[str]) -> None:
    """Install what is missing: pip, then each lock, every hash checked, then the project itself."""
    replace_pip()
    for lock in locks:
        if not stamp(lock).exists():
            print(
                f"environment: installing requirements/{lock}.txt into .venv (once)",
                file=sys.stderr,
                flush=True,
            )
            # Wheels alone: what builds a source archive is named in no lock, and may need a compiler.
            pip_install("--require-hashes", "--only-binary", ":all:", "-r", f"requirements/{lock}.txt")
            stamp(lock).touch()
    if not stamp(PROJECT).exists():
        link_mathematics()
        pip_install("--no-deps", "--no-build-isolation", "--editable", ".")
        stamp(PROJECT).touch()


def main(locks: Sequence[str]) -> None:
    """Bring `.venv` to what the locks say."""
    if sys.version_info < OLDEST:
        version = sys.version.split()[0]
        sys.exit(
            f"environment: python {version} is too old, 3.11 is needed; name one: make PYTHON=python3.12 ..."
        )
    folder = os.open(ROOT, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        if not all(stamp(held).exists() for held in (INSTALLER, *locks, PROJECT)):
            demand_writable()
        if is_stale(locks):
            create()
        fill(locks)
    finally:
        os.close(folder)


if __name__ == "__main__":
    main(sys.argv[1:])
