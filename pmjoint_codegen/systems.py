"""A model's continuous closed loop as systems of python-control: responses, interconnection, linearisation.

    systems = ClosedLoop.load("paper").to_control()
    control.input_output_response(systems.loop, t, systems.reference(t), systems.X0)

Signals are in the kernels' units. What needs a clock is left out, as by the continuous controller of a run.
For that there is `ClosedLoop.controller`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import MissingToolError, UsageError, installing
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import make_chain
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.margins import Margins, equilibrium, jacobian, margins_of
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
    _cut: OpenLoop = field(repr=False)

    __repr__ = brief

    def open_loop(
        self, t: float = 0.0, *, y_r: float | None = None, params: Mapping[str, float] | None = None
    ) -> control.StateSpace:
        """L at the equilibrium for a constant reference, the loop cut at the plant's input.

        The input is the plant's u, the output what the controller answers, negated: 1 + L = 0 is the closed
        loop. The controller's filters see its own command, not what acts after the cut. No limit is active.

        Args:
            t: the instant at which the model's reference is taken and a disturbance is frozen, s.
            y_r: another constant reference, in the kernels' unit.
            params: parameters and gains that differ, as for the systems.

        Raises:
            UsageError: there is no equilibrium, u is not inside the limits there, or the loop is not smooth.
        """
        import control

        A, B, C, _ = self._cut.linear(t, y_r, params)
        states = self.loop.state_labels
        names = {"inputs": ["u"], "outputs": ["-u"], "states": states, "name": "open_loop"}
        return control.StateSpace(A, B, C, np.zeros((1, 1)), **names)

    def margins(
        self, t: float = 0.0, *, y_r: float | None = None, params: Mapping[str, float] | None = None
    ) -> Margins:
        """Margins of `open_loop`.

        Args:
            t: as for `open_loop`.
            y_r: as for `open_loop`.
            params: as for `open_loop`.

        Raises:
            UsageError: as for `open_loop`, or the closed loop is unstable there.
        """
        return self._cut.margins(t, y_r, params)


@dataclass(frozen=True)
class OpenLoop:
    """The loop cut at the plant's input, linearised about equilibria; it needs no python-control.

    Attributes:
        manifest: of the model.
        functions: its right-hand sides and outputs.
        reference: the model's reference and its derivatives at instants, s.
    """

    manifest: Manifest
    functions: _Functions
    reference: Callable[[npt.ArrayLike], Array]

    def margins(self, t: float, y_r: float | None, params: Mapping[str, float] | None) -> Margins:
        """Margins; arguments and errors are those of `ControlSystems.margins`."""
        A, B, C, z = self.linear(t, y_r, params)
        return margins_of(A, B, C, z[: self.manifest.nx], float(z[-1]), self._held(t, y_r))

    def linear(
        self, t: float, y_r: float | None, params: Mapping[str, float] | None
    ) -> tuple[Array, Array, Array, Array]:
        """A, B, C of L, and the operating point: all states, and u."""
        free, nx, held = self.functions.unlimited(), self.manifest.nx, self._held(t, y_r)
        commands = [held, *np.zeros(self.manifest.rho)]

        def open_loop(z: Array) -> Array:
            x, s, u = z[:nx], z[nx:-1], z[-1:]
            inputs = np.array([x[0], *commands])
            rates = free.plant_rates(t, x, u, params), free.controller_rates(t, s, inputs, params)
            return np.concatenate([*rates, -free.controller_outputs(t, s, inputs, params)[:1]])

        def closed(z: Array) -> Array:
            found = open_loop(z)
            found[-1] += z[-1]
            return found

        guess = np.append(self.functions.at_rest(params), 0.0)
        guess[0] = held
        z = equilibrium(closed, guess)
        self.functions.require_room(float(z[-1]), params)
        J = jacobian(open_loop, z)
        return J[:-1, :-1], J[:-1, -1:], J[-1:, :-1], z

    def _held(self, t: float, y_r: float | None) -> float:
        return float(self.reference(t)[0, 0]) if y_r is None else float(y_r)


def make_open_loop(evaluator: Evaluator, prepare: Prepare) -> OpenLoop:
    """Cut the loop of a model; arguments are those of `make_systems`."""
    own = prepare({})
    functions = _Functions(evaluator, prepare)
    return OpenLoop(evaluator.manifest, functions, lambda t: _reference(evaluator, own, t))


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
    cut = make_open_loop(evaluator, prepare)
    functions = cut.functions
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
        cut.reference,
        initial_state(evaluator, own),
        left_out(manifest, "continuous"),
        cut,
    )


def reference_names(rho: int) -> list[str]:
    """Names of the reference and its derivatives: y_r, dy_r, d2y_r, ..."""
    return ["y_r", "dy_r", *(f"d{k}y_r" for k in range(2, rho + 1))][: rho + 1]


class _Functions:
    """The right-hand sides and outputs, from the kernels."""

    def __init__(self, evaluator: Evaluator, prepare: Prepare, limited: bool = True) -> None:
        names = ("law", "filters", "compensator", "plant", "actuation")
        self._law, self._filters, self._compensator, self._plant, self._actuation = map(
            evaluator.kernel, names
        )
        learns = any(item.name == "estimation" for item in evaluator.manifest.functions)
        self._estimation = evaluator.kernel("estimation") if learns else None
        self._manifest, self._prepare = evaluator.manifest, prepare
        self._evaluator, self._limited = evaluator, limited
        self._present: tuple[dict[str, float], Settings, Any, Array] | None = None

    def _values(self, params: Mapping[str, float] | None) -> tuple[Array, Any, Array]:
        """The parameters, the valve and the limits of its channels, kept while `params` stay the same."""
        given = dict(params or {})
        if self._present is None or self._present[0] != given:
            settings = self._prepare(given)
            chain = make_chain(self._manifest, settings.parameters, 1.0)
            (limits,) = self._actuation(settings.p)
            limits = limits.reshape(-1, 4).copy()
            if not self._limited:
                chain = replace(chain, lower=-np.inf, upper=np.inf)
                limits[:, 2:] = -np.inf, np.inf
            self._present = given, settings, chain, limits
        _, settings, chain, limits = self._present
        return settings.p, chain, limits

    def unlimited(self) -> _Functions:
        """The same without limits of the actuator and its channels."""
        return _Functions(self._evaluator, self._prepare, limited=False)

    def require_room(self, u: float, params: Mapping[str, float] | None) -> None:
        """Refuse a command that some limit of the actuator or its channels stops, or that lies on one."""
        _, chain, limits = self._values(params)
        _, free, unlimited = self.unlimited()._values(params)
        w, ends = free.channels(unlimited, u)[1:], limits[1:, 2:]
        if chain.lower < u < chain.upper and np.all((ends[:, 0] < w) & (w < ends[:, 1])):
            return
        raise UsageError(
            f"the equilibrium needs u = {u:.6g}, which is not inside the actuator's limits",
            where="margins",
            remedy="ask for a y_r that the plant can hold within them",
        )

    def controller_rates(self, _t: float, s: Array, u: Array, params: Mapping[str, float] | None) -> Array:
        """Rates of xi, Xi, lambda and r: (14), (23); of the estimates."""
        p, chain, _ = self._values(params)
        y, s, v = _vector(u[:1]), _vector(s), self._control(s, u, p)
        acting = np.array([chain.u_of(self._command(chain, float(v[0])))])
        rates = [*self._filters(y, s, acting, p), *self._compensator(y, s, acting - v, p)]
        if self._estimation is not None:
            rates += self._estimation(y, s, _vector(u[1:]), acting, v, p)
        return np.concatenate(rates)

    def at_rest(self, params: Mapping[str, float] | None) -> Array:
        """X with the plant's states at 0 and the controller where it starts."""
        p, _, _ = self._values(params)
        named = {name: p[i : i + 1] for i, name in enumerate(self._manifest.parameter_names)}
        return np.concatenate([np.zeros(self._manifest.nx), self._manifest.start.at_rest(named, 1)[0]])

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
