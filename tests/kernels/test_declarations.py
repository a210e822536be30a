"""cffi's declarations are data: what is kept of them cannot execute anything."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmjoint_codegen.errors import BuildError
from pmjoint_codegen.kernels.declarations import load_module, to_module

HEADER = "typedef struct { double a; int b; } pair;\nint add(pair *p, double x);"


def test_declarations_survive_as_data() -> None:
    ffi = load_module(to_module(HEADER))
    pair = ffi.new("pair *", {"a": 1.5, "b": 2})
    assert (pair.a, pair.b) == (1.5, 2)


@pytest.mark.parametrize(
    "text",
    [
        "import pathlib\npathlib.Path({mark!r}).touch()\nffi = FFI('x')",
        "import pathlib\nffi = FFI(pathlib.Path({mark!r}).touch())",
        "ffi = FFI('x', _types=open({mark!r}, 'w'))",
        "",
        "ffi = 1",
        "ffi = (",
    ],
)
def test_planted_text_is_refused_unexecuted(text: str, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    with pytest.raises(BuildError):
        load_module(text.replace("{mark!r}", repr(str(mark))))
    assert not mark.exists()
