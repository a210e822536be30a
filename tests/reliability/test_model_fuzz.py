"""A hundred thousand mangled model files: each is read or refused in one line; none crashes, hangs, executes.

The mangling is seeded, so a finding can be repeated: bytes flipped, cut, doubled and spliced; scraps of
expressions in the place of expressions; numbers of every size in the place of numbers. Most die in the TOML
parser, as they would in life; so a third are mangled after it, key by key.
"""

from __future__ import annotations

import copy
import random
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.expressions import parse
from pmjoint_codegen.modelfile.reader import parse_document
from pmjoint_codegen.modelfile.schema import validate

COUNT = 100_000
PARTS = 10  # so that workers share them
SLOWEST = 5.0  # s, for one input; a hang would be longer by far, a busy machine would not
SCRAPS = [
    "y", "x1", "t", "d1", "b0", "pi", "**", "*", "+", "-", "/", "(", ")", "99999", "1e400", "0.1", "1e-300",
    "sin(", "exp(", "log(", "tanh(", "sqrt(", ",", ".", "[", "]", "__import__('os')", "y.__class__",
    "lambda: 0",
    "1if y else 0", "y**y**y**99999", "((((((((", "9" * 400, "-" * 50, "\\x00", "\u202e", "\uff59",
    "e", "E", "I", "oo", "nan", "zoo", ";", "=", "'", "#", "\n",
]  # fmt: skip
VALUES: list[Any] = [
    None, True, -1, 0, 1, 2**63 - 1, -0.0, 1e308, 5e-324, float("inf"), float("nan"), "", "y", "x" * 10_000,
    [], {}, [[]], [1, "y"], [["0"], ["y"]], {"value": 1}, "0" * 5000, "(" * 900, "-" * 900 + "y",
    "y**" * 200 + "2", "9**9**9**9", "exp(" * 60 + "y" + ")" * 60,
]  # fmt: skip


def mangled_bytes(text: bytes, choose: random.Random) -> bytes:
    """A few changes of bytes."""
    data = bytearray(text)
    for _ in range(choose.randint(1, 4)):
        place = choose.randrange(len(data))
        match choose.randrange(5):
            case 0:
                data[place] ^= 1 << choose.randrange(8)
            case 1:
                del data[place : place + choose.randint(1, 40)]
            case 2:
                data[place:place] = data[place : place + choose.randint(1, 200)]
            case 3:
                data[place:place] = choose.choice(SCRAPS).encode()
            case _:
                other = choose.randrange(len(data))
                data[place:place] = data[other : other + choose.randint(1, 60)]
        data = data or bytearray(b"\n")
    return bytes(data)


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key) of a document."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in items:
        yield value, key
        yield from places(entry)


def mangled_document(document: dict[str, Any], choose: random.Random) -> dict[str, Any]:
    """A few keys with other values, or gone."""
    changed = copy.deepcopy(document)
    for _ in range(choose.randint(1, 3)):
        container, key = choose.choice(list(places(changed)))
        if isinstance(container, dict) and choose.random() < 0.1:
            del container[key]
        else:
            container[key] = copy.deepcopy(choose.choice(VALUES))
    return changed


def expression(choose: random.Random) -> str:
    """Scraps of expressions in a row."""
    return "".join(choose.choice(SCRAPS) for _ in range(choose.randint(1, 14)))


def attempt(kind: int, text: bytes, document: dict[str, Any], choose: random.Random) -> None:
    """Read one input of some kind."""
    import sympy as sp

    if kind == 0:
        validate(parse_document(mangled_bytes(text, choose).decode("utf-8-sig"), "m.toml"), "m.toml")
    elif kind == 1:
        validate(mangled_document(document, choose), "m.toml")
    else:
        names = {name: sp.Symbol(name, real=True) for name in ("y", "d1", "b0")}
        assert isinstance(parse(expression(choose), names, "m.toml"), sp.Expr)


@pytest.fixture
def audited() -> Iterator[list[str]]:
    """Collect every event that would mean that an input got something executed or opened."""
    events: list[str] = []
    watching = [True]
    watched = (
        "os.system",
        "subprocess.Popen",
        "exec.input",
        "socket.connect",
        "os.remove",
        "os.rename",
        "shutil.rmtree",
    )

    def hook(event: str, _arguments: tuple[Any, ...]) -> None:
        if watching and event in watched:
            events.append(event)

    sys.addaudithook(hook)
    yield events
    watching.clear()


@pytest.mark.parametrize("part", range(PARTS))
def test_any_input_is_read_or_refused_in_one_line(root: Path, audited: list[str], part: int) -> None:
    text = (root / "models" / "paper.toml").read_bytes()
    document = parse_document(text.decode(), "m.toml")
    choose = random.Random(part)
    read = refused = 0
    for i in range(COUNT // PARTS):
        state, begun = choose.getstate(), time.perf_counter()
        try:
            attempt(i % 3, text, document, choose)
            read += 1
        except UnicodeDecodeError:
            refused += 1  # the reader says so of a file's bytes before they are text
        except ModelError as error:
            refused += 1
            assert str(error).isprintable() and len(str(error)) < 1000, (part, i)
        except Exception as error:
            pytest.fail(f"part {part}, input {i}, {type(error).__name__}: {error}; state {hash(state)}")
        assert time.perf_counter() - begun < SLOWEST, (part, i)
    assert read and refused
    assert audited == []
