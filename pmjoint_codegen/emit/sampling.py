"""The functions of the sampled loop, composed from the table's rows; single runs and sweeps share them.

``sample``, one whole sample: the reference, the law, the actuator, Taylor coefficients of the plant and of
the tracking error under the held w, the controller's next state. ``plant_taylor``, the coefficients only, up
to a higher order, for longer holds; ``plant_guard``, a bound on their error. The error e = y - y_r is a
separate channel, so its metrics follow from its polynomial without evaluating the reference again; the
arguments of kinks follow it.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from pmjoint_codegen.emit.guard import looks_at_actuator
from pmjoint_codegen.emit.taylor import taylor_function
from pmjoint_codegen.emit.vocabulary import Vocabulary

HOLD_ORDER = 5  # of ``sample``: one step over a hold of 1 ms at 1e-10
PLANT_ORDER = 10  # of ``plant_taylor``: one step over a hold of 10 ms at 1e-10; see docs/design.md
SAMPLED = ("sample",)  # the functions in ``sampled.h``


def sample(
    name: str,
    reference: ca.Function,
    law: ca.Function,
    actuation: ca.Function,
    plant: ca.Function,
    update: ca.Function,
) -> ca.Function:
    """One sample: y taken, v of (29), w of (10), the plant under w, the controller's next state.

    A kink counts on the side on which its argument is at the sample, or on neither where that is 0.
    """
    held = taylor_function("held", plant, HOLD_ORDER, state="x")
    nx, kinks = held.size1_in("x"), plant.size1_out("kinks") if "kinks" in plant.name_out() else 0
    nw = held.size1_in("w") - kinks
    t, p = ca.SX.sym("t"), ca.SX.sym("p", law.size1_in("p"))
    X, h = ca.SX.sym("X", nx + law.size1_in("s")), ca.SX.sym("h", update.size1_in("h"))
    x, s = X[:nx], X[nx:]
    y_r = reference(t, p)
    v = law(x[0], s, y_r, p)[2]
    limits = actuation(p)
    w = ca.vertcat(
        *(
            ca.fmin(ca.fmax(limits[4 * j] + limits[4 * j + 1] * v, limits[4 * j + 2]), limits[4 * j + 3])
            for j in range(nw)
        )
    )
    sides = ca.SX.ones(kinks)
    for j in range(kinks):
        sides[j] = ca.sign(plant(t, x, ca.vertcat(w, sides), p)[2][j])
    results = [v, w, held(t, x, ca.vertcat(w, sides), p), update(x[0], s, y_r, w[0], v, h, p)]
    return ca.Function(name, [t, X, h, p], ca.cse(results), ["t", "X", "h", "p"], ["v", "w", "c", "s_next"])


def sampled_sizes(words: Vocabulary, functions: Mapping[str, ca.Function]) -> dict[str, int]:
    """The sizes of the vectors as constants of C, the order, and whether one look serves many holds.

    It does if the guard does not depend on the actuator's output, which changes in every hold.
    """
    return {
        "PMJ_RHO": functions["law"].size1_in("y_r") - 1,
        "PMJ_NX": len(words.x),
        "PMJ_NS": len(words.x) + len(words.s),
        "PMJ_NW": len(words.w),
        "PMJ_NP": len(words.p),
        "PMJ_NH": len(words.h),
        "PMJ_NK": len(words.kinks),
        "PMJ_HOLD_ORDER": HOLD_ORDER,
        "PMJ_WINDOWS": int(not looks_at_actuator(functions["plant_guard"], len(words.w))),
    }


def symbols_of(function: ca.Function) -> list[ca.SX]:
    """Fresh symbols for a function's inputs."""
    return [ca.SX.sym(label, function.size1_in(i)) for i, label in enumerate(function.name_in())]
