"""One thread at a time in CasADi."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from pmjoint_codegen.kernels.tape import FILE_NAME, read_tapes
from pmjoint_codegen.kernels.turn import alone

TIMEOUT_S = 60.0


def test_a_second_thread_waits_and_the_same_thread_does_not() -> None:
    inside, leave = threading.Event(), threading.Event()
    order: list[str] = []

    @alone
    def first() -> None:
        inside.set()
        assert leave.wait(TIMEOUT_S)
        nested()

    @alone
    def nested() -> None:
        order.append("first")

    @alone
    def second() -> None:
        order.append("second")

    one = threading.Thread(target=first)
    one.start()
    assert inside.wait(TIMEOUT_S)
    two = threading.Thread(target=second)
    two.start()
    two.join(0.1)
    assert order == []
    leave.set()
    one.join(TIMEOUT_S)
    two.join(TIMEOUT_S)
    assert order == ["first", "second"]


def test_kernels_built_while_another_thread_rebuilds_tapes_are_the_same(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`rebuild` switches CasADi's simplifications off, for the whole process."""
    pytest.importorskip("casadi")
    from pmjoint_codegen.emit.functions import build_functions, lane_functions
    from pmjoint_codegen.emit.tape import tapes_of
    from pmjoint_codegen.kernels import interpreted
    from pmjoint_codegen.modelfile import model_of
    from pmjoint_codegen.modelfile.reader import read_document
    from pmjoint_derive import derive

    file = root / "models" / "third-order.toml"
    derivation = derive(model_of(read_document(file), str(file)))

    def built() -> list[object]:
        functions = build_functions(derivation, 2)
        return [*tapes_of([*functions.values(), *lane_functions(functions).values()])]

    alone_in_process = built()
    inside, leave = threading.Event(), threading.Event()
    honest = interpreted._rebuilt

    def slow(casadi: object, tape: object) -> object:
        inside.set()
        assert leave.wait(TIMEOUT_S)
        return honest(casadi, tape)  # type: ignore[arg-type]

    monkeypatch.setattr(interpreted, "_rebuilt", slow)
    tape = read_tapes((root / "generated" / "paper" / FILE_NAME).read_text(encoding="utf-8"))["law"]
    other = threading.Thread(target=interpreted.rebuild, args=(tape,))
    other.start()
    assert inside.wait(TIMEOUT_S)
    timer = threading.Timer(0.2, leave.set)
    timer.start()
    try:
        assert built() == alone_in_process
    finally:
        leave.set()
        other.join(TIMEOUT_S)
        timer.join(TIMEOUT_S)
