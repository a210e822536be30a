"""The rooms of docs/design.md, proved from the source text: who imports whom, and what no module does."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = "pmjoint_codegen"

DESIGN = ROOT / "docs" / "design.md"
HEADER = "| room | does | imports | when called |"
RUNTIME = ("compile", "kernels", "loops", "logs", "simulate", "sweep", "tune", "closed_loop")
SYMBOLIC = {"pmjoint_derive", "sympy", "casadi", "pint", "pydantic", "mpmath"}


@dataclass(frozen=True)
class Import:
    """One import that runs: where it stands, what it names, and whether it waits for a call."""

    file: Path
    line: int
    module: str
    deferred: bool

    @property
    def top(self) -> str:
        """The distribution's own name: what stands before the first dot."""
        return self.module.partition(".")[0]

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line} imports {self.module}"


def is_type_checking(node: ast.AST) -> bool:
    """Say whether a statement is `if TYPE_CHECKING:`, whose body never runs."""
    return isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")


def named(node: ast.Import | ast.ImportFrom, file: Path) -> Iterator[str]:
    """Name the modules of one import statement; `from a import b` names `a.b` where that is one."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
        return
    tests = file.is_relative_to(ROOT / "tests")  # no packages: their `.conftest` is the file beside them
    assert node.level == 0 or tests, f"{file}:{node.lineno}: imports are absolute in this project"
    module = "." * node.level + (node.module or "")
    for alias in node.names:
        path = ROOT.joinpath(*module.split("."), alias.name)
        yield f"{module}.{alias.name}" if path.is_dir() or path.with_suffix(".py").is_file() else module


def imports(file: Path) -> list[Import]:
    """Return every import of a file that can run, `import_module` of a literal included."""
    found: list[Import] = []

    def visit(node: ast.AST, deferred: bool) -> None:
        if is_type_checking(node):
            return
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.extend(Import(file, node.lineno, module, deferred) for module in named(node, file))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "import_module":
            names = (argument for argument in node.args if isinstance(argument, ast.Constant))
            found.extend(Import(file, node.lineno, str(name.value), deferred) for name in names)
        inside = deferred or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            visit(child, inside)

    visit(ast.parse(file.read_text(encoding="utf-8")), False)
    return found


def sources(*parts: str) -> list[Path]:
    """Return the Python files of packages or modules of `pmjoint_codegen`, each of which must exist."""
    files: list[Path] = []
    for part in parts:
        place = ROOT / PACKAGE / part
        here = sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
        assert here and all(file.is_file() for file in here), (
            f"{place} is gone: update the layers in this test"
        )
        files += here
    return files


def faults(files: Iterable[Path], allowed: object) -> list[str]:
    """Describe each import of `files` that the predicate `allowed` refuses."""
    assert callable(allowed)
    return [str(found) for file in files for found in imports(file) if not allowed(found)]


def within(module: str, packages: Iterable[str]) -> bool:
    """Say whether a dotted module is one of `packages` or lies inside one."""
    return any(module == package or module.startswith(f"{package}.") for package in packages)


Arrows = dict[str, tuple[set[str], set[str]]]  # room -> what it imports at once, and only when called


def designed() -> Arrows:
    """Read the table of docs/design.md, in its order."""
    lines = DESIGN.read_text(encoding="utf-8").split(HEADER)[1].splitlines()[2:]
    rows = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in lines[: lines.index("")]]
    return {
        room: (set(at_once.split(", ")) - {""}, set(called.split(", ")) - {""})
        for room, _, at_once, called in rows
    }


def room_of(module: str, rooms: Iterable[str]) -> str:
    """Name the innermost room that a module of this project lies in; other modules by their distribution."""
    top, _, rest = module.partition(".")
    if top == "pmjoint_derive":
        return "derive"
    if top != PACKAGE or not rest:
        return top
    inside = [room for room in rooms if within(rest, [room])]
    assert inside, f"{module} lies in no room of docs/design.md"
    return max(inside, key=len)


def drawn(rooms: Iterable[str]) -> Arrows:
    """Collect what the source imports, room by room; the standard library and a room itself do not count."""
    found: Arrows = {room: (set(), set()) for room in rooms}
    for file in [*(ROOT / "derive").rglob("*.py"), *(ROOT / PACKAGE).rglob("*.py")]:
        dotted = ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        room = "derive" if file.is_relative_to(ROOT / "derive") else room_of(dotted, rooms)
        for item in imports(file):
            other = room_of(item.module, rooms)
            if other != room and other not in sys.stdlib_module_names and room != PACKAGE:
                found[room][item.deferred].add(other)
    return {room: (at_once, called - at_once) for room, (at_once, called) in found.items()}


def differing(table: Arrows, source: Arrows) -> list[str]:
    """Describe each row that is not what the source imports: the cells that it should have."""
    return [
        f"{room}: imports | {', '.join(sorted(at_once))} | {', '.join(sorted(called))} |"
        for room, (at_once, called) in source.items()
        if table[room] != (at_once, called)
    ]


def rewritten(text: str, source: Arrows) -> str:
    """Give docs/design.md with the cells that the source imports."""
    lines = text.splitlines(keepends=True)
    for place, line in enumerate(lines):
        cells = line.split("|")
        if len(cells) == 6 and (room := cells[1].strip(" `")) in source:
            arrows = (f" {', '.join(sorted(side))} " for side in source[room])
            lines[place] = "|".join([*cells[:3], *arrows, cells[5]])
    return "".join(lines)


def test_each_room_imports_what_the_design_says_and_no_row_says_more() -> None:
    table = designed()
    remedy = "take the import out, or write the cells: python tests/test_layers.py"
    assert differing(table, drawn(table)) == [], remedy


def test_an_arrow_too_many_or_too_few_is_seen() -> None:
    table = designed()
    for change in ({"tune"}, {"errors"}):
        at_once, called = table["storage"]
        assert differing({**table, "storage": (at_once ^ change, called)}, table) == [
            f"storage: imports | {', '.join(sorted(at_once))} | {', '.join(sorted(called))} |"
        ]


def test_data_goes_one_way() -> None:
    """No room imports, at once or when called, what stands below it in the table."""
    table = designed()
    order = list(table)
    assert [
        f"{room} imports {other}, below it"
        for room, arrows in table.items()
        for other in sorted(set.union(*arrows) & table.keys())
        if order.index(other) >= order.index(room)
    ] == []


def test_importing_the_package_imports_nothing_else() -> None:
    assert [
        str(found)
        for found in imports(ROOT / PACKAGE / "__init__.py")
        if found.top not in sys.stdlib_module_names
    ] == []


def test_every_room_is_there() -> None:
    places = [
        ROOT / PACKAGE / room.replace(".", "/") for room in designed() if room not in ("derive", PACKAGE)
    ]
    assert [place for place in places if not (place.is_dir() or place.with_suffix(".py").is_file())] == []


def test_the_mathematics_is_imported_by_the_name_that_is_installed() -> None:
    assert (ROOT / "pmjoint_derive").resolve() == ROOT / "derive"
    files = [file for file in tracked() if file.suffix == ".py"]
    assert faults(files, lambda found: found.top != "derive") == []


def own_files(module: str) -> list[Path]:
    """Return the files that importing a module of this project runs: its packages' own and its own."""
    parts = module.split(".")
    places = [ROOT.joinpath(*parts[: i + 1]) for i in range(len(parts))]
    return [
        file
        for place in places
        for file in (place / "__init__.py", place.with_suffix(".py"))
        if file.is_file()
    ]


def loaded_at_once(files: Iterable[Path]) -> list[Import]:
    """Return the imports that importing these files runs, those of the project's own modules followed."""
    pending, seen, found = list(files), set[Path](), []
    while pending:
        file = pending.pop()
        if file not in seen:
            seen.add(file)
            found += [item for item in imports(file) if not item.deferred]
            pending += [
                other for item in imports(file) if not item.deferred for other in own_files(item.module)
            ]
    return found


def test_commands_import_heavy_things_when_called() -> None:
    light = {"click", PACKAGE, *sys.stdlib_module_names}
    assert [str(found) for found in loaded_at_once(sources("cli")) if found.top not in light] == []


@pytest.mark.parametrize("room", RUNTIME)
def test_the_runtime_loads_nothing_symbolic(room: str) -> None:
    assert [str(found) for found in loaded_at_once(sources(room)) if found.top in SYMBOLIC] == []


def test_figures_import_matplotlib_when_drawn() -> None:
    files = sorted((ROOT / PACKAGE).rglob("*.py"))
    assert faults(files, lambda found: found.deferred or found.top != "matplotlib") == []


def module_statements(tree: ast.Module) -> Iterator[ast.stmt]:
    """Yield the statements that run at import, those under a module-level `if`, `try` or `with` included."""
    pending: list[ast.stmt] = list(tree.body)
    while pending:
        node = pending.pop()
        yield node
        for field in ("body", "orelse", "finalbody"):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                pending.extend(getattr(node, field, []))


CONTAINERS = (ast.List, ast.Dict, ast.Set, ast.ListComp, ast.DictComp, ast.SetComp)
MAKERS = re.compile(r"(\w+\.)*(list|dict|set|bytearray|defaultdict|deque|Counter|OrderedDict)\(.*", re.DOTALL)
CHANGES = {"add", "append", "clear", "extend", "insert", "pop", "popitem", "remove", "setdefault", "update"}


def containers(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and name of each list, dict or set that is bound at import."""
    for node in module_statements(tree):
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(node.value, CONTAINERS) or MAKERS.fullmatch(ast.unparse(node.value)):
                yield node.lineno, ast.unparse(target)


def changed(tree: ast.Module) -> set[str]:
    """Return the names whose content the module changes somewhere."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript) and not isinstance(node.ctx, ast.Load):
            names.add(ast.unparse(node.value))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGES:
            names.add(ast.unparse(node.func.value))
    return names


def mutable_state(file: Path) -> Iterator[str]:
    """Describe what lets a module remember: containers that are no constants, `global`, cached functions."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    place = file.relative_to(ROOT)
    written = changed(tree)
    for line, name in containers(tree):
        if name != "__all__" and (name in written or not name.isupper()):
            yield f"{place}:{line} {name} is a container that is no constant"
    for node in ast.walk(tree):
        if isinstance(node, ast.Global):
            yield f"{place}:{node.lineno} global"
        if isinstance(node, ast.FunctionDef):
            marks = " ".join(ast.unparse(mark) for mark in node.decorator_list)
            if re.search(r"\b(lru_cache|cache)\b", marks):
                yield f"{place}:{node.lineno} {node.name} is cached between calls"


def test_modules_hold_no_state() -> None:
    files = [*sorted((ROOT / PACKAGE).rglob("*.py")), *sorted((ROOT / "derive").rglob("*.py"))]
    assert [fault for file in files for fault in mutable_state(file)] == []


def test_the_state_check_can_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    file = tmp_path / "bad.py"
    constants = "TABLE = dict(a=1)\nFIXED = [1]\nif FIXED:\n    seen = {}\n"
    function = "@cache\ndef f():\n    global x\n    TABLE.update(b=2)\n"
    file.write_text(constants + function, encoding="utf-8")
    assert sorted(fault.split(" ", 1)[1] for fault in mutable_state(file)) == [
        "TABLE is a container that is no constant",
        "f is cached between calls",
        "global",
        "seen is a container that is no constant",
    ]


def tracked() -> list[Path]:
    """Return the files that git would commit."""
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    done = subprocess.run(listing, cwd=ROOT, check=False, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"not a git checkout: {done.stderr.strip()}")
    return [file for name in done.stdout.split("\0") if name and (file := ROOT / name).is_file()]


def test_no_file_names_a_registry_or_a_machine() -> None:
    hosts = ["pypi" + ".org", "python" + "hosted", "deb" + ".debian", "registry" + ".npmjs"]
    places = r"(?:^|[^\w.])/(?:work|farm|root|home/\w+)/"
    pattern = re.compile("|".join([*map(re.escape, hosts), places]).encode(), re.MULTILINE)
    assert [str(file.relative_to(ROOT)) for file in tracked() if pattern.search(file.read_bytes())] == []


def test_modules_stay_small() -> None:
    files = [
        file for file in tracked() if file.suffix in {".py", ".c", ".h"} and "generated" not in file.parts
    ]
    assert {
        str(file.relative_to(ROOT)): n for file in files if (n := file.read_bytes().count(b"\n")) > 400
    } == {}


if __name__ == "__main__":
    DESIGN.write_text(rewritten(DESIGN.read_text(encoding="utf-8"), drawn(designed())), encoding="utf-8")
