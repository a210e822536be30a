"""C text of Taylor kernels in two phases an order (see ``compact``)."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from pmjoint_codegen.emit.compact import WIDTH, Compact
from pmjoint_codegen.emit.scalar_text import kernel, statements
from pmjoint_codegen.emit.straight_text import Instruction, Print, definition, signature


def compact_kernel(compact: Compact) -> str:
    """A Taylor kernel in CasADi's calling convention, and the functions that it is made of.

    ``terms[group][0 and 1][j]`` holds the coefficients j of the x and of the y of eight sums. The number of
    rows is odd: a power of two would put all of them into the same few sets of a cache.
    """
    name, start, rise = compact.name, compact.start, compact.rise
    groups = max(-(-len(compact.pairs) // WIDTH), 1)
    rows = compact.order + 1 + compact.order % 2
    rates, fixed = (max(start.size1_out(i), 1) for i in (1, 2))
    inputs = ", ".join(f"arg[{i}]" for i in range(start.n_in()))
    body = f"""\
double r[{fixed}], q[2][{rates}], S[{groups}][{WIDTH}], terms[{groups}][2][{rows}][{WIDTH}];
double *c = res[0];
{name}_start({inputs}, c, q[0], r);
for (int k = 1; k <= {compact.order}; ++k) {{
    const double scalars[3] = {{k, 1.0 / k, k == 1}};
    for (int i = 0; i < {groups}; ++i) {{
        {name}_sums(k, terms[i][0][0], terms[i][1][0], S[i]);
    }}
    {name}_rise(scalars, q[(k + 1) % 2], r, S[0], c + {start.size1_out(0)} * k, q[k % 2], terms[0][0][k]);
}}"""
    return f"""\
{_definition(start, statements)}

/* S[l] = sum of x[j][l] y[k - j][l] for j = 1..k-1, each in order; rows of {WIDTH} */
static void {name}_sums(int k, const double *restrict x, const double *restrict y, double *restrict S)
{{
    double s[{WIDTH}] = {{0.0}};
    for (int j = 1; j < k; ++j) {{
        for (int l = 0; l < {WIDTH}; ++l) {{
            s[l] += x[{WIDTH} * j + l] * y[{WIDTH} * (k - j) + l];
        }}
    }}
    for (int l = 0; l < {WIDTH}; ++l) {{
        S[l] = s[l];
    }}
}}

{_definition(rise, lambda listing: _stored(listing, _places(compact.pairs, groups, rows)))}

{kernel(name, start.n_in(), 1, body.splitlines())}"""


def _definition(function: ca.Function, printed: Print) -> str:
    return definition(function, signature(function, f"static void {function.name()}(", "double"), printed)


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


def _stored(listing: Sequence[Instruction], places: dict[int, list[int]]) -> list[str]:
    """The lines of phase B, in which a stored coefficient goes to all its places."""
    lines: list[str] = []
    for item, text in zip(listing, statements(listing), strict=True):
        label, _, entry = item.result.rstrip("]").partition("[")
        if item.operation == ca.OP_OUTPUT and label == "a":
            lines += [f"a[{place}]{text.removeprefix(item.result)}" for place in places[int(entry)]]
        else:
            lines.append(text)
    return lines
