"""C text of Taylor kernels in two phases per order (see ``compact``)."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pmjoint_codegen.emit.compact import WIDTH, Compact
from pmjoint_codegen.emit.print_c import Dialect, definition, print_c, signature
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.kernels.tape import Tape

_STORED = re.compile(r"a\[(\d+)\] = (.*)")


def phases(compact: Compact, dialect: Dialect) -> tuple[list[str], list[str]]:
    """The functions that a kernel in phases calls, and the lines of its own body.

    ``terms[group][0 and 1][j]`` holds the coefficients j of the x and of the y of eight sums. The number of
    rows is odd: a power of two would map all of them to the same few cache sets.
    """
    name, number, (zero, one) = compact.name, dialect.number, map(dialect.literal, (0.0, 1.0))
    start, rise = tape_of(compact.start), tape_of(compact.rise)
    groups = max(-(-len(compact.pairs) // WIDTH), 1)
    rows = compact.order + 1 + compact.order % 2
    channels, rates, fixed = (max(size, 1) for _, size in start.outputs)
    inputs = ", ".join(f"arg[{i}]" for i in range(len(start.inputs)))
    body = f"""\
{number} r[{fixed}], q[2][{rates}], S[{groups}][{WIDTH}], terms[{groups}][2][{rows}][{WIDTH}];
{number} *c = res[0];
{name}_start({inputs}, c, q[0], r);
for (int k = 1; k <= {compact.order}; ++k) {{
    const {number} scalars[3] = {{k, {one} / k, k == 1}};
    for (int i = 0; i < {groups}; ++i) {{
        {name}_sums(k, terms[i][0][0], terms[i][1][0], S[i]);
    }}
    {name}_rise(scalars, q[(k + 1) % 2], r, S[0], c + {channels} * k, q[k % 2], terms[0][0][k]);
}}"""
    sums = f"""\
/* S[l] = sum of x[j][l] y[k - j][l] for j = 1..k-1, each in order; rows of {WIDTH} */
static void {name}_sums(int k, const {number} *restrict x, const {number} *restrict y, {number} *restrict S)
{{
    {number} s[{WIDTH}] = {{{zero}}};
    for (int j = 1; j < k; ++j) {{
        for (int l = 0; l < {WIDTH}; ++l) {{
            s[l] += x[{WIDTH} * j + l] * y[{WIDTH} * (k - j) + l];
        }}
    }}
    for (int l = 0; l < {WIDTH}; ++l) {{
        S[l] = s[l];
    }}
}}"""
    lines = _stored(print_c(rise, dialect), _places(compact.pairs, groups, rows))
    return [
        definition(start, _head(start, number), print_c(start, dialect)),
        sums,
        definition(rise, _head(rise, number), lines),
    ], body.splitlines()


def _head(tape: Tape, number: str) -> str:
    return signature(tape, f"static void {tape.name}(", number)


def _places(pairs: Sequence[tuple[int, int]], groups: int, rows: int) -> dict[int, list[int]]:
    """Where each stored coefficient belongs in ``terms``, counted from row k of the first group's x.

    Sums that fill up the last group repeat the first one.
    """
    padded = [*pairs, *([pairs[0]] * (groups * WIDTH - len(pairs)) if pairs else [])]
    places: dict[int, list[int]] = {}
    for i, pair in enumerate(padded):
        for side, entry in enumerate(pair):
            places.setdefault(entry, []).append((2 * (i // WIDTH) + side) * rows * WIDTH + i % WIDTH)
    return places


def _stored(lines: Sequence[str], places: dict[int, list[int]]) -> list[str]:
    """The lines of phase B, in which a stored coefficient goes to all its places."""
    found: list[str] = []
    for line in lines:
        stored = _STORED.fullmatch(line)
        entries = places[int(stored[1])] if stored else []
        found += [f"a[{place}] = {stored[2]}" for place in entries] if stored else [line]
    return found
