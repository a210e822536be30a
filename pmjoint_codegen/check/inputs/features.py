"""Finds where a model's functions are of order one: only there can an error in them show.

``exp(-(y - 30)**2)`` is 0 in doubles wherever y is of order one, and so is its contribution to a wrong law.
So points are also drawn where the arguments of exponentials, hyperbolic tangents, logarithms and powers are
near 0 or 1. The places are found numerically, for the parameters of each point: a scan over all magnitudes
of one input, then ever finer ones about the best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.manifest import Function
from pmjoint_codegen.operations import by_sympy
from pmjoint_derive import Derivation, Equations

Array = npt.NDArray[np.float64]
Values = Callable[[Mapping[sp.Symbol, float | Array]], Array]

NEAR: Final = 0.75  # of the target: logarithms and powers keep arguments above 1/4
FAR: Final = 30.0  # from the target at best: exp(-30) is negligible compared with 1
LARGEST: Final = 1e6  # of an input that is scanned
ZOOMS: Final = 12
WIDEST: Final = 3.0  # of the surroundings of a place, as wide as inputs are drawn elsewhere


@dataclass(frozen=True)
class Feature:
    """A function whose value matters at some places only.

    Attributes:
        argument: of the function; for a power, its base.
        target: value of the argument at which the function and its slopes are of order one.
    """

    argument: sp.Expr
    target: float


@dataclass(frozen=True)
class Features:
    """All features of a model, with the data to place them among the inputs of a kernel.

    Attributes:
        items: the features.
        equations: definitions of names that are not inputs.
        moving: symbols along which a point can be moved: t, y and the plant's states.
        blocks: label -> symbols of the blocks in features.
    """

    items: tuple[Feature, ...]
    equations: Equations
    moving: frozenset[sp.Symbol]
    blocks: Mapping[str, tuple[sp.Symbol, ...]]

    @classmethod
    def of(cls, derivation: Derivation, p: Sequence[sp.Symbol], x: Sequence[sp.Symbol]) -> Features:
        """The features of a model.

        Args:
            derivation: every expression in it is searched.
            p: symbols of the parameters, as kernels take them.
            x: states of the simulated plant, as kernels take them.
        """
        s = derivation.signals
        moving = frozenset({s.t, s.y, *x})
        expressions = [item.expression for item in derivation.equations.values()]
        found = dict.fromkeys(feature for expression in expressions for feature in _in(expression, moving))
        blocks = {"t": (s.t,), "y": (s.y,), "x": tuple(x), "X": tuple(x), "p": tuple(p)}
        return cls(tuple(found), derivation.equations, moving, blocks)

    def near(
        self, function: Function, arguments: tuple[Array, ...], random: np.random.Generator
    ) -> tuple[Array, ...] | None:
        """Move points to where features are of order one, each row to the next feature; None without any.

        Args:
            function: the kernel.
            arguments: the points, one array per input, shape (points, size); they are not changed.
            random: chooses places near a feature.
        """
        moved = tuple(array.copy() for array in arguments)
        places = self._places(function)
        if not (movers := list(self._movers(places))):
            return None
        for row in range(len(moved[0])):
            target, by, values = movers[row % len(movers)]
            fixed = {symbol: float(moved[block][row, entry]) for symbol, (block, entry) in places.items()}
            found = _place(partial(_along, values, fixed, by), target, random)
            if found is not None:
                block, entry = places[by]
                moved[block][row, entry] = found
        return moved

    def count(self, function: Function) -> int:
        """How many rows `near` needs to visit every feature of a kernel's inputs once."""
        return sum(1 for _ in self._movers(self._places(function)))

    def _places(self, function: Function) -> dict[sp.Symbol, tuple[int, int]]:
        """Input and entry of every symbol that a kernel takes and features may contain."""
        return {
            symbol: (block, entry)
            for block, (label, _) in enumerate(function.inputs)
            for entry, symbol in enumerate(self.blocks.get(label, ()))
        }

    def _movers(
        self, places: Mapping[sp.Symbol, tuple[int, int]]
    ) -> Iterator[tuple[float, sp.Symbol, Values]]:
        """Target, symbol to move and argument of every feature that is a function of a kernel's inputs."""
        seen = set()
        for item in self.items:
            argument = self.equations.expand(item.argument, keep=frozenset(places))
            symbols = sorted(argument.free_symbols, key=str)
            if not set(symbols) <= set(places) or (argument, item.target) in seen:
                continue
            seen.add((argument, item.target))
            values = partial(_evaluate, sp.lambdify(symbols, argument, "numpy"), tuple(symbols))
            yield from ((item.target, by, values) for by in symbols if by in self.moving)


def _evaluate(
    compiled: Callable[..., Array], names: tuple[sp.Symbol, ...], known: Mapping[sp.Symbol, float | Array]
) -> Array:
    with np.errstate(all="ignore"):
        return np.asarray(compiled(*(known[name] for name in names)), dtype=np.float64)


def _along(values: Values, fixed: Mapping[sp.Symbol, float | Array], by: sp.Symbol, at: Array) -> Array:
    """The argument as a function of one symbol."""
    return values({**fixed, by: at})


def _in(expression: sp.Expr, moving: frozenset[sp.Symbol]) -> Iterator[Feature]:
    """Features of one expression; sines and cosines are of order one everywhere."""
    known = by_sympy()
    for node in sp.preorder_traversal(expression):
        operation = known.get(type(node).__name__)
        if operation is not None and operation.feature is not None:
            feature = Feature(node.args[0], operation.feature)
        elif isinstance(node, sp.Pow) and not node.base.is_Symbol and not node.base.is_number:
            feature = Feature(node.base, 1.0)
        elif isinstance(node, sp.Pow) and node.exp.free_symbols and node.base.is_number:
            feature = Feature(node.exp, 0.0)
        else:
            continue
        if feature.argument.free_symbols & moving and _is_plain(feature.argument):
            yield feature


def _is_plain(argument: sp.Expr) -> bool:
    """Whether NumPy can evaluate it directly."""
    return not argument.has(sp.Max, sp.Min, sp.Abs, sp.sign)


def _place(argument: Callable[[Array], Array], target: float, random: np.random.Generator) -> float | None:
    """A value at which the argument is near its target, or as near as it comes; None if that is far off."""

    def distance(at: Array) -> Array:
        found = np.abs(np.broadcast_to(argument(at), at.shape) - target)
        return np.where(np.isfinite(found), found, np.inf)

    positive = np.geomspace(1e-4, LARGEST, 400)
    grid = np.concatenate([-positive[::-1], [0.0], positive])
    for _ in range(ZOOMS):
        best = int(np.argmin(distance(grid)))
        grid = np.linspace(grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)], 65)
    found = distance(grid)
    place, closest = float(grid[np.argmin(found)]), float(np.min(found))
    if not closest <= FAR:
        return None
    side = float(random.choice([-1.0, 1.0]))
    steps = np.concatenate([[0.0], np.geomspace(1e-9, WIDEST, 200)])
    beyond = np.append(~(distance(place + side * steps) <= closest + NEAR), True)
    far = float(steps[max(int(np.argmax(beyond)) - 1, 0)])
    return place + side * far * float(random.uniform(0.0, 1.0))
