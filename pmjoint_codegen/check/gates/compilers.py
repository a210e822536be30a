"""Compilers and analysers: the generated C compiles without warnings and accesses only its arguments.

CasADi's calling convention passes ``iw``, ``w`` and ``mem`` to every function whether it uses them or not, so
``-Wno-unused-parameter`` is the one disabled warning. It is confined: an unused parameter of any other name
makes the gate fail.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pmjoint_codegen.check import harness
from pmjoint_codegen.check.result import Difference, GateResult, failed, not_run, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.compile.library import ARITHMETIC
from pmjoint_codegen.kernels.compiled import GENERATED
from pmjoint_codegen.operations import by_name
from pmjoint_codegen.scratch import scratch

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
CONVENTION = ("arg", "res", "iw", "w", "mem", "i")  # of CasADi: kernels take all but i; its accessors take i
BITS = (*ARITHMETIC, "-O0", "-g")  # unoptimised: the source's arithmetic, compiled quickly
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
TIME_LIMIT = 120  # s, for any one tool


@dataclass(frozen=True)
class Outcome:
    """The result of a tool.

    Attributes:
        code: its exit code.
        output: its standard output.
        messages: its standard error.
    """

    code: int
    output: bytes
    messages: str

    @property
    def first_line(self) -> str:
        """The first line that states the error."""
        lines = [line for line in self.messages.splitlines() if line.strip()]
        telling = [line for line in lines if "error" in line.lower() or "warning" in line.lower()]
        return (telling or lines or [f"exit code {self.code}"])[0].strip()


def run(command: Sequence[str], folder: Path, given: bytes = b"") -> Outcome:
    """Run a tool in a folder, with given standard input."""
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder)},  # a compiler that is killed leaves files there
            input=given,
            capture_output=True,
            check=False,
            timeout=TIME_LIMIT,
        )
    except subprocess.TimeoutExpired:
        return Outcome(-1, b"", f"error: {command[0]} took more than {TIME_LIMIT} s")
    return Outcome(done.returncode, done.stdout, done.stderr.decode(errors="replace"))


def sources(subject: Subject) -> dict[str, str]:
    """The generated C as it is."""
    return {name: (subject.folder / name).read_text(encoding="utf-8") for name in GENERATED}


def units(files: Mapping[str, str]) -> list[str]:
    """Names of the compiled files; headers are included by them."""
    return sorted(name for name in files if name.endswith(".c"))


def write(folder: Path, files: Mapping[str, str]) -> None:
    """Write sources into a folder."""
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def missing(subject: Subject, *tools: str) -> str:
    """The first tool that is not on the path, or nothing."""
    path = subject.environment.get("PATH")
    return next((tool for tool in tools if shutil.which(tool, path=path) is None), "")


def check_gcc(subject: Subject) -> GateResult:
    """No warning from gcc."""
    return _warnings(subject, "gcc")


def check_clang(subject: Subject) -> GateResult:
    """No warning from clang."""
    return _warnings(subject, "clang")


def _warnings(subject: Subject, tool: str) -> GateResult:
    return not_run(f"no {tool}") if missing(subject, tool) else warnings(tool, sources(subject))


def warnings(tool: str, files: Mapping[str, str]) -> GateResult:
    """Compile with all warnings; unused parameters are checked separately: the calling convention has some.

    Args:
        tool: compiler.
        files: the C sources by name.
    """
    with scratch("pmjoint-check") as folder:
        write(folder, files)
        strict = run([tool, *WARNINGS, "-Wno-unused-parameter", "-O1", "-c", *units(files)], folder)
        unused = run([tool, "-std=c99", "-Wunused-parameter", "-fsyntax-only", *units(files)], folder)
    stray = [
        line for line in unused.messages.splitlines() if "warning:" in line and not _of_the_convention(line)
    ]
    if strict.code or stray:
        line = strict.first_line if strict.code else stray[0]
        return failed(line, None, None, Difference(tool, "warning", "", "none", line, "", ""))
    return passed(
        f"warnings of {' '.join(WARNINGS)}; unused {', '.join(CONVENTION)} of CasADi's convention allowed",
        0,
        0,
    )


def _of_the_convention(line: str) -> bool:
    found = re.search(r"unused parameter\W+(\w+)", line)
    return found is not None and found.group(1) in CONVENTION


def check_sanitizers(subject: Subject) -> GateResult:
    """No memory error, no undefined behaviour, and the same bits."""
    tool = next((tool for tool in ("gcc", "clang") if not missing(subject, tool)), "")
    if not tool:
        return not_run("no gcc or clang")
    return watched(subject, [tool, *BITS, *SANITIZERS], [])


def check_valgrind(subject: Subject) -> GateResult:
    """No uninitialised value reaches a result, no memory error."""
    if missing(subject, "valgrind"):
        return not_run("no valgrind")
    if subject.compiler is None:
        return not_run("no C compiler")
    watch = ["valgrind", "--quiet", "--error-exitcode=9", "--exit-on-first-error=yes", "--leak-check=full"]
    return watched(subject, [*subject.compiler.command, *BITS], watch)


def watched(
    subject: Subject,
    compiler: Sequence[str],
    watch: Sequence[str],
    files: Mapping[str, str] | None = None,
) -> GateResult:
    """Run every kernel under a checking tool, and compare bits with the interpreter's.

    Args:
        subject: the model.
        compiler: command and flags.
        watch: command that runs the program; empty to run it directly.
        files: C sources by name, the generated ones by default.
    """
    questions, answers = subject.fed
    given = files or sources(subject)
    with scratch("pmjoint-check") as folder:
        write(folder, {**given, "main.c": harness.program(subject.manifest)})
        made = run([*compiler, "main.c", *units(given), "-o", "watched", "-lm"], folder)
        if made.code and "sanitize" in " ".join(compiler) and "cannot find" in made.messages:
            return not_run(f"no sanitizer library: {made.first_line}")
        if made.code:
            return failed(
                made.first_line,
                None,
                None,
                Difference(compiler[0], "compilation", "", "", made.messages, "", ""),
            )
        done = run([*watch, "./watched"], folder, questions)
    unequal = harness.differing(answers, done.output)
    if done.code or unequal:
        line = done.first_line if done.code else f"{unequal} results differ in their bits"
        return failed(
            line, unequal, 0, Difference((*watch, "watched")[0], "run", "", "", done.messages[:2000], "", "")
        )
    return passed(f"findings and results with other bits, of {len(answers) // 8} results", 0, 0)


def check_objects(subject: Subject) -> GateResult:
    """No allocation, no static state, no recursion: read off the object files."""
    if subject.compiler is None:
        return not_run("no C compiler")
    if lacking := missing(subject, "nm", "objdump"):
        return not_run(f"no {lacking}")
    return objects(subject.compiler.command, sources(subject))


def objects(compiler: Sequence[str], files: Mapping[str, str]) -> GateResult:
    """Check the symbols and relocations of the compiled kernels, one section per function.

    Args:
        compiler: command.
        files: the C sources by name.
    """
    with scratch("pmjoint-check") as folder:
        write(folder, files)
        flags = ["-std=c99", "-O0", "-ffunction-sections", "-fno-builtin", "-fno-stack-protector"]
        made = run([*compiler, *flags, "-c", *units(files)], folder)
        if made.code:
            return failed(
                made.first_line,
                None,
                None,
                Difference(compiler[0], "compilation", "", "", made.messages, "", ""),
            )
        made_objects = sorted(path.name for path in folder.glob("*.o"))
        symbols = run(["nm", "-A", *made_objects], folder).output.decode()
        relocations = run(["objdump", "-r", *made_objects], folder).output.decode()
    faults = [*symbol_faults(symbols), *recursion_faults(relocations)]
    if faults:
        return failed(
            faults[0],
            len(faults),
            0,
            Difference("object files", "symbols", "", "", "; ".join(faults), "", ""),
        )
    return passed("calls outside the mathematical library, static mutable objects and recursions", 0, 0)


def symbol_faults(listing: str) -> list[str]:
    """Symbols that ``nm`` must not list: calls that are not mathematics, and writable data."""
    faults = []
    library = {name for name, item in by_name().items() if "(" in item.scalar}
    for line in listing.splitlines():
        *_, kind, symbol = line.split()
        if kind == "U" and symbol not in library and not symbol.startswith("_GLOBAL_OFFSET_TABLE_"):
            faults.append(f"calls {symbol}")
        if kind in "bBdDcCsSgG":
            faults.append(f"static mutable object {symbol}")
    return faults


def recursion_faults(listing: str) -> list[str]:
    """Cycles in the calls that ``objdump -r`` lists, one section ``.text.NAME`` per function."""
    calls: dict[str, set[str]] = {}
    section = ""
    for line in listing.splitlines():
        if header := re.search(r"RELOCATION RECORDS FOR \[\.text\.(\w+)\]", line):
            section = header.group(1)
        elif line.startswith("RELOCATION"):
            section = ""
        elif section and (target := re.search(r"\s(?:\.text\.)?(\w+)(?:[-+]0x[0-9a-f]+)?$", line)):
            calls.setdefault(section, set()).add(target.group(1))
    return [f"{name} calls itself" for name in calls if name in _reachable(name, calls)]


def _reachable(start: str, calls: Mapping[str, Iterable[str]]) -> set[str]:
    found: set[str] = set()
    pending = list(calls.get(start, ()))
    while pending:
        name = pending.pop()
        if name not in found:
            found.add(name)
            pending += calls.get(name, ())
    return found


def check_cppcheck(subject: Subject) -> GateResult:
    """No finding of cppcheck."""
    return not_run("no cppcheck") if missing(subject, "cppcheck") else cppcheck(sources(subject))


def cppcheck(files: Mapping[str, str]) -> GateResult:
    """Analyse the C with cppcheck.

    Args:
        files: the C sources by name.
    """
    with scratch("pmjoint-check") as folder:
        write(folder, files)
        flags = ["--std=c99", "--enable=warning,performance,portability", "--error-exitcode=1", "--quiet"]
        flags.append("--max-configs=1")  # the others differ in macros of other platforms' linkers
        done = run(["cppcheck", *flags, *units(files)], folder)
    if done.code:
        found = Difference("cppcheck", "finding", "", "none", done.messages[:2000], "", "")
        return failed(done.first_line, None, None, found)
    return passed("findings of warning, performance and portability", 0, 0)
