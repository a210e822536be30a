"""C text of functions over lanes (see ``print_c``).

A value of the C is a vector that holds one double of each trajectory (``pmj_lanes`` of ``pmjoint_lanes.h``).
Two things differ from CasADi's C: the sine and cosine of one argument are computed together, and a divisor
that occurs more than once is inverted once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pmjoint_codegen.emit.print_c import Dialect, definition, print_c, signature
from pmjoint_codegen.kernels.tape import Tape


def dialect() -> Dialect:
    """Vectors of doubles."""
    return Dialect(
        "pmj_lanes",
        spelling=lambda operation: operation.lanes,
        fill="pmj_all({})",
        together={("sin", "cos"): "pmj_sincos"},
        inverts=True,
    )


def lanes_source(tapes: Sequence[Tape], head: str) -> str:
    """``lanes.c``: every function, in order."""
    bodies = "\n\n".join(definition(tape, _signature(tape), print_c(tape, dialect())) for tape in tapes)
    return f'{head}#include "lanes.h"\n\n{bodies}\n'


def lanes_header(tapes: Sequence[Tape], sizes: Mapping[str, int | str], head: str) -> str:
    """``lanes.h``: the sizes as constants, for loops that the compiler unrolls, and a declaration a function.

    Args:
        tapes: what ``lanes.c`` defines.
        sizes: name -> value of each constant.
        head: the banner.
    """
    constants = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
    declarations = "\n".join(f"{_signature(tape)};" for tape in tapes)
    guard = "#ifndef PMJOINT_GENERATED_LANES_H\n#define PMJOINT_GENERATED_LANES_H"
    return f'{head}{guard}\n\n#include "pmjoint_lanes.h"\n\n{constants}\n\n{declarations}\n\n#endif\n'


def _signature(tape: Tape) -> str:
    return signature(tape, f"void pmj_{tape.name}(", dialect().number)
