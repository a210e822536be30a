"""The places of model files, generated folders and the cache. Nothing here reads or writes a model.

A model is given by name (``paper``) or path (``my/joint.toml``). Names are searched for in ``models/`` under
the current directory or the nearest folder above it that has one, then in ``models/`` of the checkout that
the package is imported from, then among the models of the installed package.
"""

from __future__ import annotations

import os
import shlex
import stat
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from pmjoint_codegen.errors import ModelError, did_you_mean, quoted
from pmjoint_codegen.storage import make_private

MODELS = "models"
GENERATED = "generated"


def find_model(model: str | os.PathLike[str], *, cwd: Path | None = None) -> Path:
    """Find a model's TOML file.

    Args:
        model: a name such as ``paper``, or a path: it ends in ``.toml`` or contains a separator.
        cwd: directory that relative paths start from; by default the current one, with relative results.

    Raises:
        ModelError: there is no such file; the message names the existing models and the closest one.
    """
    here = cwd or Path()
    text = os.fspath(model)
    if _is_path(text):
        return _existing(here / text, here)
    for folder in model_folders(here):
        if os.path.isfile(
            file := folder / f"{text}.toml"
        ):  # unlike Path.is_file, False for an impossible name
            return file
    raise ModelError(f"no model is called {quoted(text)}", remedy=_advice(text, known_models(here), here))


def known_models(cwd: Path | None = None) -> tuple[str, ...]:
    """All model names that are valid here, in alphabetical order."""
    return tuple(sorted({file.stem for folder in model_folders(cwd) for file in folder.glob("[!.]*.toml")}))


def model_folders(cwd: Path | None = None) -> tuple[Path, ...]:
    """Folders in which a model's name is searched for, in order; only those that exist."""
    package = Path(__file__).resolve().parent
    checkout = package.parent
    candidates = [project_models(cwd)]
    if (checkout / "pyproject.toml").is_file():  # without it, the parent is somebody's site-packages
        candidates.append(checkout / MODELS)
    candidates.append(package / "_data" / MODELS)
    found: dict[Path, Path] = {}
    for folder in candidates:
        if folder.is_dir():
            found.setdefault(folder.resolve(), folder)
    return tuple(found.values())


def project_models(cwd: Path | None = None) -> Path:
    """The folder of the project's own models, where a new one belongs: the nearest from here upwards.

    Without any, it is ``models/`` here. A folder above counts if it holds models, and the search ends below
    a folder that another user owns or may write to.
    """
    here = cwd or Path()
    own = here / MODELS
    if own.is_dir():
        return own
    for folder in here.absolute().parents:
        level = folder.stat()
        if level.st_uid != os.getuid() or level.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            break
        above = folder / MODELS
        if any(above.glob("[!.]*.toml")):
            return above if cwd else Path(os.path.relpath(above))
    return own


def called(model_file: Path) -> str:
    """A model file's name on a command line: its stem if that finds it, else its path, quoted."""
    found = (folder / model_file.name for folder in model_folders() if (folder / model_file.name).is_file())
    first = next(found, None)
    named = first is not None and first.resolve() == model_file.resolve()
    return model_file.stem if named else shlex.quote(str(model_file))


def is_stream(file: Path) -> bool:
    """Whether a model comes from a pipe, ``/dev/stdin`` or the like, which can be read once."""
    return os.path.exists(file) and not os.path.isfile(file) and not os.path.isdir(file)


def generated_root(model_file: Path) -> Path:
    """Folder that holds ``<name>/`` for this model: beside its ``models/`` folder, else beside the file.

    A model from a pipe has it in the current directory.
    """
    if is_stream(model_file):
        return Path(GENERATED)
    folder = model_file.parent
    if folder.name != MODELS:
        folder = folder.absolute()  # the current directory may itself be a models/ folder
    return (folder.parent if folder.name == MODELS else folder) / GENERATED


def cache_dir(env: Mapping[str, str], notify: Callable[[str], None] | None = None) -> Path:
    """Folder for compiled kernels and derived models, created if needed.

    ``$PMJOINT_CACHE``, else ``$XDG_CACHE_HOME/pmjoint``, else ``~/.cache/pmjoint``. If that is unusable,
    or others could plant code in it, it is a private folder of this user under the temporary one, and
    `notify` is called with one line.
    """
    wanted, reason = cache_place(env)
    if wanted is not None and reason is None:
        return wanted
    private = _private_temporary()
    if notify is not None:
        notify(f"cache: {reason}; using {private} (set PMJOINT_CACHE to a folder of your own)")
    return private


def cache_place(env: Mapping[str, str]) -> tuple[Path | None, str | None]:
    """The folder that the environment specifies, created if needed, and why it is not used, if it is not."""
    wanted = _wanted_cache(env)
    return wanted, "no home folder is known" if wanted is None else _flaw(wanted)


def _is_path(text: str) -> bool:
    separators = [os.sep, *([os.altsep] if os.altsep else [])]
    return text.endswith(".toml") or any(mark in text for mark in separators)


def _existing(file: Path, here: Path) -> Path:
    """Return the file if it exists; otherwise list what is beside it."""
    if os.path.isfile(file) or is_stream(file):
        return file
    if os.path.isdir(file):
        raise ModelError("is a folder, not a model file", where=str(file), remedy=_known(here))
    beside = sorted(str(other) for other in file.parent.glob("*.toml")) if os.path.isdir(file.parent) else []
    raise ModelError("no such model file", where=_shown(file), remedy=_advice(str(file), beside, here))


def _shown(path: Path) -> str:
    """Show a path in a message, its middle cut out if it is very long."""
    text = str(path)
    return text if len(text) <= 300 else f"{text[:150]}...{text[-100:]}"


def _advice(asked: str, names: Iterable[str], here: Path) -> str:
    return did_you_mean(asked, names) + _known(here)


def _known(here: Path) -> str:
    names = ", ".join(known_models(here))
    return (
        f"known models: {names}, or give the path of a .toml file"
        if names
        else "give the path of a .toml file"
    )


def _wanted_cache(env: Mapping[str, str]) -> Path | None:
    if named := env.get("PMJOINT_CACHE"):
        return Path(named).absolute()
    xdg = env.get("XDG_CACHE_HOME", "")
    if os.path.isabs(xdg):  # the XDG specification: a relative path is to be ignored
        return Path(xdg) / "pmjoint"
    home = env.get("HOME", "")
    return Path(home) / ".cache" / "pmjoint" if os.path.isabs(home) else None


def distrusted(folder: Path) -> str | None:
    """State why code from a folder must not be loaded; None if only this user can have put it there.

    The folder must be the user's own and writable by nobody else. Each parent must belong to the user or
    root, and be writable by nobody else unless it is sticky: write access to a parent can replace the folder.
    """
    place = Path(os.path.realpath(folder))
    for level in (place, *place.parents):
        found = level.stat()
        shared = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if found.st_uid != os.getuid() and (level == place or found.st_uid != 0):
            return f"{level} belongs to another user"
        if shared and (level == place or not found.st_mode & stat.S_ISVTX):
            return f"other users may write to {level}"
    return None


def _flaw(folder: Path) -> str | None:
    """Make the folder; state why it cannot serve as a cache, if it cannot."""
    try:
        make_private(folder)
        if reason := distrusted(folder):
            return reason
    except (OSError, ValueError):
        return f"{folder} cannot be written"
    return None if os.access(folder, os.W_OK | os.X_OK) else f"{folder} cannot be written"


def _private_temporary() -> Path:
    """Give a private temporary folder of this user: libraries are loaded from it, so no other may write."""
    folder = Path(tempfile.gettempdir()) / f"pmjoint-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix="pmjoint-"))
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return folder if ours and _flaw(folder) is None else Path(tempfile.mkdtemp(prefix="pmjoint-"))
