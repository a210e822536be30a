"""A model's continuous closed loop as systems of python-control: responses, interconnection, linearisation.

    systems = ClosedLoop.load("paper").to_control()
    control.input_output_response(systems.loop, t, systems.reference(t), systems.X0)

Signals are in the kernels' units. What needs a clock is left out, as by the continuous controller of a run.
For that there is `ClosedLoop.controller`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import MissingToolError, installing
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import make_chain
from pmjoint_codegen.simulate.settings import Settings, left_out
from pmjoint_codegen.simulate.start import initial_state

if TYPE_CHECKING:
    import control

Prepare = Callable[[Mapping[str, float]], Settings]  # settings of a continuous run with some parameters


@dataclass(frozen=True)
class ControlSystems:
    """Systems of python-control.

    Their functions are of (t, x, u, params); `params` are values of parameters and gains by name, as for
    `ClosedLoop.simulate`, that differ from those with which the systems were made.

    Attributes:
        controller: inputs y and the reference with its derivatives, outputs u (what the actuator is told)
            and v of (29), states xi, Xi, lambda, r.
        plant: input u, output y; states as in a run, with the model's disturbance. It limits u itself.
        loop: the two together; inputs the reference with its derivatives, outputs y, u and v.
        reference: the model's reference and its derivatives at instants, s, shape (rho + 1, instants): the
            loop's inputs.
        X0: the loop's states at t = 0, shape (nX,), from the model's x0 and start.
        left_out: keys of the model that need a clock.
    """

    controller: control.NonlinearIOSystem
    plant: control.NonlinearIOSystem
    loop: control.InterconnectedSystem
    reference: Callable[[npt.ArrayLike], Array]
    X0: Array
    left_out: tuple[str, ...]


def make_systems(evaluator: Evaluator, prepare: Prepare) -> ControlSystems:
    """Make the systems of a model.

    Args:
        evaluator: of the kernels.
        prepare: settings with some parameters.

    Raises:
        MissingToolError: python-control is not installed.
    """
    try:
        import control
    except ImportError:
        raise MissingToolError(
            "python-control is needed for to_control",
            remedy=f"install it: {installing('pmjoint-codegen[control]')}",
        ) from None
    manifest, own = evaluator.manifest, prepare({})
    functions = _Functions(evaluator, prepare)
    states = [item.name for item in manifest.states]
    commands = reference_names(manifest.rho)
    controller = control.nlsys(
        functions.controller_rates,
        functions.controller_outputs,
        inputs=["y", *commands],
        outputs=["u", "v"],
        states=states[manifest.nx :],
        name="controller",
    )
    plant = control.nlsys(
        functions.plant_rates,
        functions.plant_outputs,
        inputs=["u"],
        outputs=["y"],
        states=states[: manifest.nx],
        name="plant",
    )
    loop = control.interconnect(
        [plant, controller],
        inputs=commands,
        outputs=["y", "u", "v"],
        states=states,
        name="loop",
    )
    return ControlSystems(
        controller,
        plant,
        loop,
        lambda t: _reference(evaluator, own, t),
        initial_state(evaluator, own),
        left_out(manifest, "continuous"),
    )


def reference_names(rho: int) -> list[str]:
    """Names of the reference and its derivatives: y_r, dy_r, d2y_r, ..."""
    return ["y_r", "dy_r", *(f"d{k}y_r" for k in range(2, rho + 1))][: rho + 1]


class _Functions:
    """The right-hand sides and outputs, from the kernels."""

    def __init__(self, evaluator: Evaluator, prepare: Prepare) -> None:
        names = ("law", "filters", "compensator", "plant", "actuation")
        self._law, self._filters, self._compensator, self._plant, self._actuation = map(
            evaluator.kernel, names
        )
        self._manifest, self._prepare = evaluator.manifest, prepare
        self._present: tuple[dict[str, float], Settings, Any, Array] | None = None

    def _values(self, params: Mapping[str, float] | None) -> tuple[Array, Any, Array]:
        """The parameters, the valve and the limits of its channels, kept while `params` stay the same."""
        given = dict(params or {})
        if self._present is None or self._present[0] != given:
            settings = self._prepare(given)
            chain = make_chain(self._manifest, settings.parameters, 1.0)
            (limits,) = self._actuation(settings.p)
            self._present = given, settings, chain, limits.reshape(-1, 4)
        _, settings, chain, limits = self._present
        return settings.p, chain, limits

    def controller_rates(self, _t: float, s: Array, u: Array, params: Mapping[str, float] | None) -> Array:
        """Rates of xi, Xi, lambda and r: (14), (23)."""
        p, chain, _ = self._values(params)
        y, s, v = _vector(u[:1]), _vector(s), self._control(s, u, p)
        acting = np.array([chain.u_of(self._command(chain, float(v[0])))])
        return np.concatenate([*self._filters(y, s, acting, p), *self._compensator(y, s, acting - v, p)])

    def controller_outputs(self, _t: float, s: Array, u: Array, params: Mapping[str, float] | None) -> Array:
        """The command and v."""
        p, chain, _ = self._values(params)
        v = float(self._control(s, u, p)[0])
        return np.array([self._command(chain, v), v])

    def plant_rates(self, t: float, x: Array, u: Array, params: Mapping[str, float] | None) -> Array:
        """Rates of the plant: (11)."""
        p, chain, limits = self._values(params)
        command = min(max(float(u[0]), chain.lower), chain.upper)
        w, x, kinks = chain.channels(limits, command), _vector(x), len(self._manifest.kinks)
        sides = np.ones(kinks)
        for j in range(kinks):  # an argument depends on the sides before its own
            sides[j] = np.sign(self._plant(np.array([t]), x, np.concatenate([w, sides]), p)[2][j])
        return self._plant(np.array([t]), x, np.concatenate([w, sides]), p)[0]

    def plant_outputs(self, _t: float, x: Array, _u: Array, _params: Mapping[str, float] | None) -> Array:
        """The measured output."""
        return x[:1]

    def _control(self, s: Array, u: Array, p: Array) -> Array:
        return self._law(_vector(u[:1]), _vector(s), _vector(u[1:]), p)[2]

    def _command(self, chain: Any, v: float) -> float:
        """What the actuator is told for v, without the rate: that needs a clock."""
        wanted = v + chain.zone * float(np.sign(v))
        return float(min(max(wanted, chain.lower), chain.upper))


def _vector(values: npt.ArrayLike) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)


def _reference(evaluator: Evaluator, settings: Settings, t: npt.ArrayLike) -> Array:
    """The reference and its derivatives at instants, each in its own segment where it is data."""
    times, segments = np.atleast_1d(np.asarray(t, dtype=np.float64)), settings.reference
    p = settings.p
    if segments is not None:
        p = np.tile(p, (len(times), 1))
        p[:, p.shape[1] - segments.rows.shape[1] :] = segments.rows[segments.places(times)]
    return evaluator.call("reference", times[:, np.newaxis], p)[0].T
