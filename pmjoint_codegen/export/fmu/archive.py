"""Sources and binaries of a unit in one file."""

from __future__ import annotations

import importlib.util
import io
import os
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from pmjoint_codegen.errors import BuildError, MissingToolError, installing

FLAGS: Final = ("-std=c99", "-O2", "-shared", "-fvisibility=hidden", "-ffp-contract=off")
_LIMIT: Final = 600.0  # s; the first build of a platform takes more than a minute
_DATE: Final = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Platform:
    """Where a binary runs.

    Attributes:
        folder_2: of FMI 2.0; empty if it has no name for the platform.
        folder_3: of FMI 3.0.
        suffix: of the file.
        target: as ziglang names it.
        further: flags.
    """

    folder_2: str
    folder_3: str
    suffix: str
    target: str
    further: tuple[str, ...] = ("-fPIC",)


PLATFORMS: Final = {
    "x86_64-linux": Platform("linux64", "x86_64-linux", ".so", "x86_64-linux-gnu.2.17"),
    "aarch64-linux": Platform("", "aarch64-linux", ".so", "aarch64-linux-gnu.2.17"),
    "x86_64-windows": Platform("win64", "x86_64-windows", ".dll", "x86_64-windows-gnu", ("-s",)),
    "x86_64-darwin": Platform("darwin64", "x86_64-darwin", ".dylib", "x86_64-macos"),
    "aarch64-darwin": Platform("", "aarch64-darwin", ".dylib", "aarch64-macos"),
}


@dataclass(frozen=True)
class Builder:
    """Makes the binary of one platform.

    Attributes:
        platform: where it runs.
        command: compiler and its own flags.
        variables: of its environment, beyond those of this process.
    """

    platform: Platform
    command: tuple[str, ...]
    variables: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def by_ziglang(cls, name: str, cache: Path) -> Builder:
        """For any platform of the table.

        Args:
            name: of the platform.
            cache: folder for builds; ziglang keeps the libraries of each platform there.

        Raises:
            MissingToolError: ziglang is not installed.
        """
        if importlib.util.find_spec("ziglang") is None:
            remedy = f"install it: {installing('pmjoint-codegen[compiler]')}"
            raise MissingToolError(f"ziglang is needed to build for {name}", remedy=remedy)
        platform = PLATFORMS[name]
        kept = {"ZIG_GLOBAL_CACHE_DIR": str(cache / "zig")}
        return cls(platform, (sys.executable, "-m", "ziglang", "cc", "-target", platform.target), kept)

    def binary(self, texts: Mapping[str, str], sources: Sequence[str], identifier: str) -> bytes:
        """The shared library.

        Args:
            texts: file name -> contents.
            sources: those to compile.
            identifier: name of the library.

        Raises:
            BuildError: the compiler refused the sources, or did not come to an end.
        """
        with TemporaryDirectory(prefix="pmjoint-fmu-") as folder:
            for name, text in texts.items():
                (Path(folder) / name).write_text(text, encoding="utf-8", newline="\n")
            made = f"{identifier}{self.platform.suffix}"
            flags = [*FLAGS, *self.platform.further, "-o", made, *sources]
            libraries = [] if self.platform.suffix == ".dll" else ["-lm"]
            command = [*self.command, *flags, *libraries]
            try:
                done = subprocess.run(
                    command,
                    cwd=folder,
                    env={**os.environ, **self.variables},
                    capture_output=True,
                    text=True,
                    timeout=_LIMIT,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                where = self.platform.folder_3
                raise BuildError(
                    f"the compiler took more than {_LIMIT:g} s", where=where, output=""
                ) from None
            if done.returncode != 0:
                where = self.platform.folder_3
                raise BuildError("the unit does not build", where=where, output=done.stdout + done.stderr)
            return (Path(folder) / made).read_bytes()


def zipped(files: Mapping[str, str | bytes]) -> bytes:
    """A zip file with the same bytes each time: names in order, no dates."""
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # attributes as on Unix, wherever the file is made
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, files[name])
    return held.getvalue()
