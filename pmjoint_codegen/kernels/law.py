"""The control law for single states in sequence, as a loop in Python needs it."""

from __future__ import annotations

from threading import Lock, get_ident
from typing import Any

import numpy.typing as npt

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array, PreparingEvaluator


class Law:
    """v of (29) at one state, in arrays that are allocated once.

    The contents of the arrays belong to the thread that made the law: `evaluate` and the attributes below
    are valid only there. Calls from other threads share a second law, one at a time.

    Attributes:
        y: measured output, shape (1,).
        s: controller states (xi, Xi, lambda, r), shape (ns,).
        y_r: the reference and its derivatives up to order rho, shape (rho + 1,).
        z: (24), shape (rho,); of the last evaluation, as are alpha and v.
        alpha: (25), (26), shape (rho - 1,).
        v: (29), shape (1,).
    """

    __slots__ = (
        "_lock",
        "_made_of",
        "_other",
        "_owner",
        "_places",
        "_run",
        "_value",
        "alpha",
        "s",
        "v",
        "y",
        "y_r",
        "z",
    )

    def __init__(self, evaluator: PreparingEvaluator, p: Array) -> None:
        """Prepare the law.

        Args:
            evaluator: of the kernels.
            p: parameters, shape (np,); another law is made for others.
        """
        prepared = evaluator.prepare("law")
        self.y, self.s, self.y_r, own = prepared.inputs
        own[:] = p
        self.z, self.alpha, self.v = prepared.outputs
        self._run = prepared.run
        self._value = self.v.item
        # Writing doubles into views takes half the time of arrays.
        self._places: tuple[Any, ...] = self.s.data, self.y.data, self.y_r.data
        self._owner, self._lock = get_ident(), Lock()
        self._other: Law | None = None
        self._made_of = evaluator, p

    def __reduce__(self) -> tuple[type[Law], tuple[PreparingEvaluator, Array]]:
        """Pickle and copy by its arguments; the contents of its arrays are not part of it."""
        return Law, self._made_of

    def __call__(self, state: npt.ArrayLike, y: float, reference: npt.ArrayLike) -> float:
        """Evaluate.

        Args:
            state: controller states s, shape (ns,).
            y: measured output.
            reference: y_r and its derivatives up to order rho, shape (rho + 1,).

        Raises:
            UsageError: shapes that do not fit.
        """
        if get_ident() != self._owner:  # the kernel runs without Python's lock
            return self._elsewhere(state, y, reference)
        s, at, y_r = self._places
        try:
            s[:], at[0], y_r[:] = state, y, reference
        except (TypeError, ValueError):
            self._write(state, y, reference)
        self._run()
        return self._value()

    def _elsewhere(self, state: npt.ArrayLike, y: float, reference: npt.ArrayLike) -> float:
        """Evaluate for a thread that does not own the arrays."""
        with self._lock:
            if self._other is None:
                self._other = Law(*self._made_of)
            self._other._owner = get_ident()
            return self._other(state, y, reference)

    def evaluate(self) -> float:
        """Evaluate at the values written into `s`, `y` and `y_r`: the fastest way.

        Raises:
            UsageError: another thread made the law, and may be writing into its arrays.
        """
        if get_ident() != self._owner:
            raise UsageError(
                "was made by another thread, which owns its arrays",
                where="law",
                remedy="make a law in each thread, or call it with arguments",
            )
        self._run()
        return self._value()

    def _write(self, state: npt.ArrayLike, y: float, reference: npt.ArrayLike) -> None:
        """Accept lists and other number types too, and report what does not fit."""
        try:
            fits = len(state) == len(self.s) and len(reference) == len(self.y_r)  # type: ignore[arg-type]
            self.s[:], self.y[0], self.y_r[:] = state, y, reference
        except (TypeError, ValueError):
            fits = False
        if not fits:
            rule = f"a state of length {len(self.s)}, a number, a reference of length {len(self.y_r)}"
            raise UsageError("takes other shapes", where="law", remedy=rule)
