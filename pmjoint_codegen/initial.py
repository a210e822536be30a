"""States and signals by name, and the plant's states where a run starts."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pmjoint_codegen.values import SI, Numbers, evaluate


@dataclass(frozen=True)
class Variable:
    """A state or reported signal.

    Attributes:
        name: column name.
        unit: physical unit.
        about: one line for the reader.
        scale: how many SI units `unit` is, as a decimal; given for y and u alone.
        truth: of an estimate, what it estimates: an expression of the plant's own parameters, in Python's
            notation.
    """

    name: str
    unit: str
    about: str
    scale: str = SI
    truth: str = ""


@dataclass(frozen=True)
class Start:
    """The initial values of a run, and the plant's states there.

    Attributes:
        variables: the states in x0, in order: those of the plant or, for a joint, the physical ones.
        required: how many of them must be given; the others start at 0.
        terms: the plant's states, each an expression of the variables and of parameters, in Python's
            notation. They use the plant's own parameters, so x0 means the same for all of their values.
        guesses: for each state of the controller the parameter that it starts from, or nothing: it starts at
            0. Estimates start from their guesses.
    """

    variables: tuple[Variable, ...]
    required: int
    terms: tuple[str, ...]
    guesses: tuple[str, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the variables, in order."""
        return tuple(item.name for item in self.variables)

    @cached_property
    def _trees(self) -> tuple[ast.expr, ...]:
        return tuple(ast.parse(term, mode="eval").body for term in self.terms)

    def at_rest(self, parameters: Mapping[str, Numbers], runs: int) -> Numbers:
        """The controller's states at t = 0 where it is not matched to anything, shape (runs, ns).

        Args:
            parameters: name -> values, shape (runs,).
            runs: how many.
        """
        found = np.zeros((runs, len(self.guesses)))
        for i, name in enumerate(self.guesses):
            if name:
                found[:, i] = parameters[name]
        return found

    def states(self, x0: Numbers, parameters: Mapping[str, Numbers]) -> Numbers:
        """The plant's states at t = 0, shape (runs, nx).

        Args:
            x0: of the variables, shape (runs, nx), in the units of `variables`.
            parameters: name -> values, shape (runs,).
        """
        if self.terms == self.names:
            return x0
        columns = {**parameters, **dict(zip(self.names, x0.T, strict=True))}
        with np.errstate(all="ignore"):  # the caller refuses or marks non-finite values
            found = (np.asarray(evaluate(tree, columns), dtype=np.float64) for tree in self._trees)
            return np.column_stack([np.broadcast_to(values, len(x0)) for values in found])
