"""Builds the programs of a folder and runs them: on the emulated processor, and on this machine.

A program reads ``input.bin`` and writes ``output.bin`` in the folder that it is started in. For a recorded
run they are files; for a closed loop they are named pipes. Nothing runs longer than its time limit.
"""

from __future__ import annotations

import os
import select
import shlex
import shutil
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pmjoint_codegen.compile.compiler import find_compiler, install_line
from pmjoint_codegen.errors import BuildError, CheckFailed, MissingToolError
from pmjoint_codegen.export.pil.chips import Chip
from pmjoint_codegen.export.pil.records import HEADER, TRAILER, Answer, Array, Layout, header_of
from pmjoint_codegen.scratch import scratch

BUILD_S: Final = 300.0
RUN_S: Final = 120.0
ANSWER_S: Final = 20.0  # for one sample; it takes microseconds
SCRATCH: Final = "pmjoint-pil"
_FAULTED: Final = 3  # status of the start-up code after an exception


@dataclass(frozen=True)
class Tools:
    """The programs that a run needs.

    Attributes:
        chip: the processor.
        make: path.
        size: path of the program that tells the sizes of an object's sections.
        emulator: the emulator's command as far as the image.
        host: command of this machine's compiler.
        environment: of all of them.
    """

    chip: Chip
    make: str
    size: str
    emulator: tuple[str, ...]
    host: tuple[str, ...]
    environment: Mapping[str, str]

    @classmethod
    def find(cls, chip: Chip, environment: Mapping[str, str]) -> Tools:
        """Find them; raises `MissingToolError`, whose one line names the packages."""
        size = f"{chip.prefix}size"
        paths = {
            name: shutil.which(name, path=environment.get("PATH", os.defpath))
            for name in ("make", chip.compiler, size, chip.emulator)
        }
        absent = [name for name, path in paths.items() if path is None]
        if absent:
            told = f"{', '.join(absent)} {'is' if len(absent) == 1 else 'are'} needed to run the export"
            raise MissingToolError(told, where=chip.name, remedy=f"install: apt-get install {chip.packages}")
        compiler = find_compiler(environment)
        if compiler is None:
            raise MissingToolError(
                "a C compiler for this machine is needed to compare with",
                where=chip.name,
                remedy=f"install one: {install_line()}",
            )
        _, *arguments = shlex.split(chip.emulation)
        emulator = (str(paths[chip.emulator]), *arguments)
        return cls(chip, str(paths["make"]), str(paths[size]), emulator, compiler.command, environment)

    def build(self, folder: Path) -> None:
        """Build the images and the host's programs; raises `BuildError`."""
        host = shlex.join(self.host)
        command = [self.make, "--no-print-directory", "-C", str(folder), f"CC={host}", "all", "host"]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=BUILD_S,
                check=False,
                stdin=subprocess.DEVNULL,
                env=dict(self.environment),
            )
        except subprocess.TimeoutExpired:
            raise BuildError(f"the build did not end within {BUILD_S:g} s", where=str(folder)) from None
        told = (done.stdout + done.stderr).strip()
        if done.returncode != 0:
            raise BuildError(
                "the export does not build",
                where=str(folder),
                remedy=f"it needs the Debian packages {self.chip.packages}",
                output=told,
            )

    def sections(self, file: Path) -> dict[str, int]:
        """Bytes of each section of an object or image."""
        command = [self.size, "-A", str(file)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=BUILD_S, check=False)
        rows = (line.split() for line in done.stdout.splitlines())
        return {row[0]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdecimal()}

    def emulated(self, place: Path) -> Program:
        """The controller of a folder's precision on the emulated processor."""
        return Program((*self.emulator, "-kernel", str(place / "pil.elf")), self.chip.name, self.environment)

    def native(self, place: Path) -> Program:
        """The same on this machine."""
        return Program((str(place / "host"),), "host", self.environment)


@dataclass(frozen=True)
class Program:
    """One program.

    Attributes:
        command: that starts it.
        name: where it runs, for messages.
        environment: of the process.
    """

    command: tuple[str, ...]
    name: str
    environment: Mapping[str, str]

    def recorded(self, samples: Array, layout: Layout) -> Answer:
        """Feed it recorded samples, shape (samples, inputs); raises `CheckFailed`."""
        with scratch(SCRATCH) as place:
            (place / "input.bin").write_bytes(layout.given(samples))
            with (place / "told").open("wb") as told:
                child = self._start(place, told)
                status = _ended(child, RUN_S)
            if status is None:
                raise CheckFailed(f"did not end within {RUN_S:g} s", where=self.name)
            answered = place / "output.bin"
            data = answered.read_bytes() if answered.exists() else b""
            if len(data) < HEADER.itemsize:
                raise CheckFailed(_why(status, (place / "told").read_text(errors="replace")), where=self.name)
            header_of(data, self.name)  # says more than a status
            if status != 0:
                raise CheckFailed(_why(status, (place / "told").read_text(errors="replace")), where=self.name)
            return Answer.read(data, layout, self.name)

    @contextmanager
    def session(self, layout: Layout) -> Iterator[Session]:
        """Start it with pipes, for samples that depend on its answers."""
        with scratch(SCRATCH) as place:
            for name in ("input.bin", "output.bin"):
                os.mkfifo(place / name)
            with (
                (place / "told").open("wb") as told,
                # Both open for both ways: so neither side waits for the other to open its end.
                (place / "input.bin").open("rb+", buffering=0) as into,
                (place / "output.bin").open("rb+", buffering=0) as out,
            ):
                child = self._start(place, told)
                try:
                    yield Session(self.name, layout, child, into.fileno(), out.fileno(), bytearray())
                    into.close()  # the end of the input
                    _ended(child, ANSWER_S)
                finally:
                    _ended(child, 0.0)

    def _start(self, place: Path, told: Any) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            self.command,
            cwd=place,
            env=dict(self.environment),
            stdin=subprocess.DEVNULL,
            stdout=told,
            stderr=subprocess.STDOUT,
        )


@dataclass(frozen=True)
class Session:
    """A running program.

    Attributes:
        name: where it runs.
        layout: of its records.
        child: the process.
        into, out: ends of the pipes.
        heard: all that it has said.
    """

    name: str
    layout: Layout
    child: subprocess.Popen[bytes]
    into: int
    out: int
    heard: bytearray

    def step(self, given: Sequence[float]) -> Any:
        """One sample's record; raises `CheckFailed`."""
        os.write(self.into, np.array(given, dtype=self.layout.real).tobytes())
        if not self.heard:
            self._hear(HEADER.itemsize)
            header_of(bytes(self.heard), self.name)
        record = self.layout.record
        self._hear(record.itemsize)
        return np.frombuffer(self.heard[-record.itemsize :], record)[0]

    def _hear(self, size: int) -> None:
        """Wait for some bytes."""
        wanted, end = len(self.heard) + size, time.monotonic() + ANSWER_S
        while len(self.heard) < wanted:
            ready, _, _ = select.select([self.out], [], [], 0.5)
            if ready:
                self.heard.extend(os.read(self.out, wanted - len(self.heard)))
            elif self.child.poll() is not None:
                raise CheckFailed(_why(self.child.returncode, ""), where=self.name)
            elif time.monotonic() > end:
                raise CheckFailed(f"did not answer within {ANSWER_S:g} s", where=self.name)

    @property
    def answer(self) -> Answer:
        """All answers so far, without the stack of a whole run; raises `CheckFailed` if one has flags."""
        return Answer.read(bytes(self.heard) + bytes(TRAILER.itemsize), self.layout, self.name)


def _ended(child: subprocess.Popen[bytes], patience: float) -> int | None:
    """The status of a process once it has ended; None if it had to be killed."""
    try:
        return child.wait(patience)
    except subprocess.TimeoutExpired:
        return None
    finally:
        if child.poll() is None:
            child.kill()
            child.wait()


def _why(status: int, told: str) -> str:
    """What a status means."""
    if status == _FAULTED:
        return "the processor met an exception"
    last = told.strip().splitlines()[-1:] or ["nothing was printed"]
    return f"the program ended with status {status}: {last[0]}"
