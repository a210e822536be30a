"""Sources and binaries of a unit in one file."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from subprocess import TimeoutExpired
from tempfile import TemporaryDirectory
from typing import Final

from pmjoint_codegen.compile.library import run_command
from pmjoint_codegen.compile.zig import zig_compiler
from pmjoint_codegen.errors import BuildError

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
    "x86_64-windows": Platform("win64", "x86_64-windows", ".dll", "x86_64-windows-gnu", ()),
    "x86_64-darwin": Platform("darwin64", "x86_64-darwin", ".dylib", "x86_64-macos"),
    "aarch64-darwin": Platform("", "aarch64-darwin", ".dylib", "aarch64-macos"),
}


@dataclass(frozen=True)
class Builder:
    """Makes the binary of one platform.

    Attributes:
        platform: where it runs.
        command: compiler and its own flags.
    """

    platform: Platform
    command: tuple[str, ...]

    @classmethod
    def by_ziglang(cls, name: str, env: Mapping[str, str]) -> Builder:
        """For any platform of the table.

        Args:
            name: of the platform.
            env: environment: ziglang keeps the libraries of each platform in the cache.

        Raises:
            MissingToolError: ziglang is not installed.
        """
        platform, zig = PLATFORMS[name], zig_compiler(env, f"build for {name}")
        # -s: zig's debugging information names the folder of the build
        return cls(platform, (*zig.command, "-target", platform.target, "-s"))

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
            command, where = [*self.command, *flags, *libraries], self.platform.folder_3
            try:
                code, output = run_command(command, Path(folder), _LIMIT)
            except TimeoutExpired:
                raise BuildError(f"the compiler took more than {_LIMIT:g} s", where=where) from None
            if code != 0:
                raise BuildError("the unit does not build", where=where, output=output)
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
