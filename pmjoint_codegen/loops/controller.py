"""The controller at one sample: the readable twin of ``loops/c/controller.c``.

`SampledLaw` is its arithmetic, which the loop with sensor, actuator and clock uses too. `Steps` takes one
sample after another for a caller with a plant of its own. The caller may learn only afterwards which u acted
during a hold, so a hold's update is done at the sample that ends it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from pmjoint_codegen.kernels.compiled import CompiledEvaluator
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import COMMAND, FILTERED, MEASURED, Chain, U
from pmjoint_codegen.loops.constants import (
    APPLIED_REFUSED,
    GAVE_APPLIED,
    GAVE_REFERENCE,
    READING_REFUSED,
    REFERENCE_REFUSED,
)
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest

HELD = 4  # entries of what a controller holds: reading, filtered reading, u, command


@dataclass(frozen=True)
class Layout:
    """Where a controller's values are in a block of memory.

    Attributes:
        n_s: length of its state.
        rho: relative degree.
    """

    n_s: int
    rho: int

    @classmethod
    def of(cls, manifest: Manifest) -> Layout:
        """The layout of a model's controller."""
        return cls(manifest.nX - manifest.nx, manifest.rho)

    @property
    def held(self) -> slice:
        """What is held since the sample."""
        return slice(self.n_s, self.n_s + HELD)

    @property
    def v(self) -> slice:
        """V of (29), one entry."""
        return slice(self.held.stop, self.held.stop + 1)

    @property
    def z(self) -> slice:
        """Errors z of (24)."""
        return slice(self.v.stop, self.v.stop + self.rho)

    @property
    def alpha(self) -> slice:
        """Virtual controls of (25), (26)."""
        return slice(self.z.stop, self.z.stop + self.rho - 1)

    @property
    def y_r(self) -> slice:
        """The reference and its derivatives up to order rho."""
        return slice(self.alpha.stop, self.size)

    @property
    def size(self) -> int:
        """Length of a block."""
        return self.n_s + HELD + 3 * self.rho + 1


@dataclass(frozen=True)
class Memory:
    """A controller's constants, and the arrays that it writes.

    Attributes:
        layout: of the blocks.
        chain: its numbers; those of the sensor, of the clock and of delays are not used.
        hold: matrices of `sampled_update`.
        p: parameters; the end is the reference's present segment, where the reference is data.
        begin: the controller's states before the first sample, shape (n_s,).
        now: values at the last sample, a block.
        y_r: reference and derivatives, shape (rho + 1,), of the last sample, or given for the next.
    """

    layout: Layout
    chain: Chain
    hold: Array
    p: Array
    begin: Array
    now: Array
    y_r: Array

    @classmethod
    def make(cls, manifest: Manifest, chain: Chain, hold: Array, p: Array) -> Memory:
        """Allocate the memory of a controller, at rest."""
        layout = Layout.of(manifest)
        named = {name: p[i : i + 1] for i, name in enumerate(manifest.parameter_names)}
        begin = manifest.start.at_rest(named, 1)[0]
        memory = cls(layout, chain, hold, p.copy(), begin, np.zeros(layout.size), np.zeros(manifest.rho + 1))
        memory.rest()
        return memory

    def rest(self) -> None:
        """Put every value where it is before the first sample: 0, a guess, or the limit nearest to 0."""
        self.now[:] = 0.0
        self.now[: self.layout.n_s] = self.begin
        self.now[self.layout.held][COMMAND] = self.chain.rest


class Stepping(Protocol):
    """One sample after another, compiled or interpreted.

    Attributes:
        sample: index of the next sample.
        matches: whether the first sample matches the state to its reading.
    """

    sample: int
    matches: bool

    @property
    def step(self) -> Callable[[float, float, int], int]:
        """Take a sample; unless the result is 0, nothing that the next step depends on has changed.

        Args:
            y: reading.
            applied: what the actuator was told since the last sample.
            given: sum of `GAVE_APPLIED`, if `applied` counts, and `GAVE_REFERENCE`, if y_r is in memory.

        Returns:
            0, a number ``..._REFUSED``, or a `Status`.
        """
        ...


class SampledLaw:
    """The arithmetic of one sample; its methods have the names of the C functions."""

    def __init__(self, evaluator: Evaluator, p: Array, hold: Array, chain: Chain) -> None:
        self._reference = evaluator.kernel("reference")
        self._law = evaluator.kernel("law")
        self._update = evaluator.kernel("sampled_update")
        self.p, self.hold, self.chain = p, hold, chain

    def follow(self, clock: float) -> Array:
        """y_r and its derivatives at the controller's own time, s."""
        (y_r,) = self._reference(np.array([clock]), self.p)
        return y_r

    def decide(self, s: Array, y_r: Array, read: float, k: int, held: Array) -> tuple[Array, ...]:
        """Sample k: z, alpha and v from a reading, and what is held, from the last sample's."""
        held[MEASURED] = read
        held[FILTERED] = self.chain.filtered(read, float(held[FILTERED]), k)
        z, alpha, v = self._law(held[FILTERED : FILTERED + 1].copy(), s, y_r, self.p)
        held[COMMAND] = self.chain.command(float(v[0]), float(held[COMMAND]))
        held[U] = self.chain.u_of(float(held[COMMAND]))
        return z, alpha, v

    def advance(self, s: Array, y_r: Array, held: Array, u: float, v: Array) -> Array:
        """The controller's state at the next sample, if u acts until then."""
        y = held[FILTERED : FILTERED + 1].copy()
        (s_next,) = self._update(y, s, y_r, np.array([u]), v, self.hold, self.p)
        return s_next


class Steps(SampledLaw):
    """`Stepping` with interpreted kernels."""

    def __init__(self, evaluator: Evaluator, memory: Memory) -> None:
        super().__init__(evaluator, memory.p, memory.hold, memory.chain)
        self._start = evaluator.kernel("start")
        self.memory = memory
        self.sample = 0
        self.matches = False

    def step(self, y: float, applied: float, given: int) -> int:
        """Take a sample; see `Stepping`."""
        memory, layout, k = self.memory, self.memory.layout, self.sample
        y, applied = float(y), float(applied)
        told = bool(given & GAVE_APPLIED) and k > 0
        if not math.isfinite(y):
            return READING_REFUSED
        if told and not math.isfinite(applied):
            return APPLIED_REFUSED
        if not given & GAVE_REFERENCE:
            memory.y_r[:] = self.follow(k * self.chain.period)
        if not np.all(np.isfinite(memory.y_r)):
            return REFERENCE_REFUSED
        held = memory.now[layout.held].copy()
        s = self._arrive(y, self.chain.u_of(applied) if told else float(held[U]))
        z, alpha, v = self.decide(s, memory.y_r, y, k, held)
        then = np.concatenate([s, held, v, z, alpha, memory.y_r])
        if not np.all(np.isfinite(then)):
            return Status.NON_FINITE
        memory.now[:] = then
        self.sample = k + 1
        return 0

    def _arrive(self, y: float, u: float) -> Array:
        """The state at this sample: the hold that ends now has known its u only since."""
        now, layout = self.memory.now, self.memory.layout
        s = now[: layout.n_s].copy()
        if self.sample > 0:
            return self.advance(s, now[layout.y_r], now[layout.held], u, now[layout.v])
        if self.matches:
            (s,) = self._start(np.array([y]), self.memory.y_r, self.p)
        return s


class CompiledSteps:
    """`Stepping` in C.

    Attributes:
        step: see `Stepping`.
    """

    def __init__(self, evaluator: CompiledEvaluator, memory: Memory) -> None:
        ffi, layout = evaluator.ffi, memory.layout
        names = {"reference": "reference", "law": "law", "update": "sampled_update", "start": "start"}
        bound = {key: evaluator.function(name) for key, name in names.items()}
        then, chain = np.zeros(layout.size), memory.chain.vector()
        arrays = {"p": memory.p, "hold": memory.hold, "chain": chain, "y_r": memory.y_r}
        pointers = {key: ffi.from_buffer("double[]", array) for key, array in arrays.items()}
        blocks = {key: _places(ffi, layout, array) for key, array in (("now", memory.now), ("then", then))}
        sizes = {"n_values": layout.size, "n_reference": len(memory.y_r), "n_s": layout.n_s}
        kernels = {key: function.struct for key, function in bound.items()}
        self._struct = ffi.new(
            "pmj_controller *", {**kernels, **pointers, **{k: b for k, (b, _) in blocks.items()}, **sizes}
        )
        self._kept = evaluator.lib, bound, arrays, pointers, blocks  # into which the struct points
        # An attribute, as a method around it would take as long as the step.
        self.step: Callable[[float, float, int], int] = partial(
            evaluator.lib.pmj_controller_step, self._struct
        )

    @property
    def sample(self) -> int:
        """Index of the next sample."""
        return int(self._struct.sample)

    @sample.setter
    def sample(self, value: int) -> None:
        self._struct.sample = value

    @property
    def matches(self) -> bool:
        """Whether the first sample matches the state to its reading."""
        return bool(self._struct.matches)

    @matches.setter
    def matches(self, value: bool) -> None:
        self._struct.matches = value


def make_steps(evaluator: Evaluator, memory: Memory) -> Stepping:
    """Prepare a controller: the C one if the kernels are compiled, its Python twin if not."""
    if isinstance(evaluator, CompiledEvaluator):
        return CompiledSteps(evaluator, memory)
    return Steps(evaluator, memory)


def _places(ffi: Any, layout: Layout, block: Array) -> tuple[dict[str, Any], Any]:
    """A block's values as pointers, and what keeps its memory."""
    whole = ffi.from_buffer("double[]", block)
    starts = {"s": 0, "held": layout.held.start, "v": layout.v.start, "z": layout.z.start}
    starts |= {"alpha": layout.alpha.start, "y_r": layout.y_r.start}
    return {key: whole + start for key, start in starts.items()}, whole
