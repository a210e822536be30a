"""The input of a derivation: a plant of the output-feedback class, the gains and the run to simulate.

The class is (11) for general order: ``x' = A x + phi(y) + Phi(y) theta + b sigma(y) u + D(x, t)``, ``y =
x1``, with ``A`` the upper shift matrix. Members are checked when they are made; anything outside the
class is refused with the reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import sympy as sp

from pmjoint_derive.adaptation import Adaptation
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.units import Measures


class OutsideClassError(ValueError):
    """The model is outside the class that the design covers.

    Attributes:
        key: the key of the model that is at fault, such as ``plant.b``.
        what: what is wrong.
        remedy: what to do about it.
    """

    def __init__(self, key: str, what: str, remedy: str) -> None:
        """Store the three parts of the message."""
        super().__init__(f"{key}: {what}; {remedy}")
        self.key = key
        self.what = what
        self.remedy = remedy


@dataclass(frozen=True)
class Parameter:
    """A named number of the plant, settable at run time.

    Attributes:
        name: identifier in expressions and on the command line.
        value: default, in SI units where `scale` says so.
        unit: physical unit for the reader, such as ``rad/(s^2 V)``.
        about: one line for the reader.
        scale: how many SI units `unit` is, as a decimal: the reader is shown `value` divided by it.
    """

    name: str
    value: float
    unit: str
    about: str
    scale: str = "1"

    @property
    def symbol(self) -> sp.Symbol:
        """The parameter's symbol in expressions."""
        return real_symbol(self.name)


@dataclass(frozen=True)
class Plant:
    """The plant that the controller is designed for, (11) in general order.

    Attributes:
        order: number of states n.
        phi: n known functions of y.
        Phi: n rows of p known functions of y, multiplying ``theta``.
        theta: p expressions of parameters (known; the adaptive design would estimate them).
        b: input coefficients ``b_m ... b_0``; the relative degree is ``rho = n - m = n + 1 - len(b)``.
        sigma: input nonlinearity, a function of y.
        disturbance: n functions of x1..xn, t and parameters; simulated, unknown to the controller.
    """

    order: int
    phi: tuple[sp.Expr, ...]
    Phi: tuple[tuple[sp.Expr, ...], ...]
    theta: tuple[sp.Expr, ...]
    b: tuple[sp.Expr, ...]
    sigma: sp.Expr
    disturbance: tuple[sp.Expr, ...]

    def __post_init__(self) -> None:
        """Refuse a plant outside the class.

        Raises:
            OutsideClassError: lengths that disagree, ``b_m = 0``, ``sigma = 0``, or an expression of a signal
                that the
                controller cannot know.
        """
        self._check_lengths()
        if sp.expand(self.b[0]) == 0:
            raise OutsideClassError(
                "plant.b",
                "the leading coefficient b_m is zero",
                "drop it: the relative degree is then one higher",
            )
        if sp.expand(self.sigma) == 0:
            raise OutsideClassError(
                "plant.sigma", "sigma is zero, so no input acts", "give a sigma that never vanishes"
            )
        self._check_symbols()

    def _check_lengths(self) -> None:
        expected = {
            "plant.phi": (len(self.phi), self.order),
            "plant.Phi": (len(self.Phi), self.order),
            "plant.disturbance": (len(self.disturbance), self.order),
        }
        for key, (found, wanted) in expected.items():
            if found != wanted:
                raise OutsideClassError(key, f"has {found} entries", f"give {wanted}, one for each state")
        if any(len(row) != len(self.theta) for row in self.Phi):
            raise OutsideClassError(
                "plant.Phi", "a row is not as long as theta", f"give {len(self.theta)} columns"
            )
        if not 1 <= len(self.b) <= self.order:
            raise OutsideClassError(
                "plant.b", f"has {len(self.b)} entries", f"give 1 to {self.order}: b_m ... b_0"
            )

    def _check_symbols(self) -> None:
        hidden = {real_symbol(f"x{i}") for i in range(1, self.order + 1)} | {real_symbol("t")}
        known = {
            "plant.phi": self.phi,
            "plant.Phi": tuple(entry for row in self.Phi for entry in row),
            "plant.sigma": (self.sigma,),
        }
        for key, entries in known.items():
            for symbol in sorted(set().union(*(entry.free_symbols for entry in entries)) & hidden, key=str):
                measured = symbol == real_symbol("x1")
                why = "which is y here" if measured else "which the controller does not measure"
                raise OutsideClassError(key, f"depends on {symbol}, {why}", "use y and parameters only")
        measured = hidden | {real_symbol("y")}
        for key, entries in {"plant.theta": self.theta, "plant.b": self.b}.items():
            for symbol in sorted(set().union(*(entry.free_symbols for entry in entries)) & measured, key=str):
                raise OutsideClassError(key, f"depends on {symbol}", "use parameters only")

    @property
    def m(self) -> int:
        """Degree of the input polynomial: the number of zeros."""
        return len(self.b) - 1

    @property
    def rho(self) -> int:
        """Relative degree ``n - m``."""
        return self.order - self.m

    @property
    def p(self) -> int:
        """Number of entries of ``theta``."""
        return len(self.theta)

    @property
    def drift(self) -> tuple[sp.Expr, ...]:
        """``phi + Phi theta`` of (11), n functions of y."""
        return tuple(
            sum((entry * factor for entry, factor in zip(row, self.theta, strict=True)), known)
            for known, row in zip(self.phi, self.Phi, strict=True)
        )

    def known_rates(self, u: sp.Expr) -> tuple[sp.Expr, ...]:
        """``phi + Phi theta + b sigma u`` of (11): what the design's model knows of x_i' beyond x_{i+1}.

        Args:
            u: the applied input.
        """
        return tuple(drift + b * self.sigma * u for drift, b in zip(self.drift, self.b_vector, strict=True))

    @property
    def b_vector(self) -> tuple[sp.Expr, ...]:
        """The input vector ``(0, ..., 0, b_m, ..., b_0)`` of length n."""
        return (sp.Integer(0),) * (self.rho - 1) + self.b


@dataclass(frozen=True)
class Gains:
    """Default design gains; they become the parameters c1.., e1.., ck1.., k1.. .

    Attributes:
        c: rho damping gains of the backstepping errors.
        e: rho nonlinear-damping gains against the estimation error.
        ck: rho decay rates of the compensator (23).
        k: n filter gains, such that ``A0 = A - k e1'`` is Hurwitz (14).
        compensator: False keeps r = 0, that is, plain clipping.
        matched: whether a run starts with the controller matched to y(0), not at zero.
        braking: the share of the actuator's limit that a braking compensator reckons with; None: (23).
        observer: bandwidth of an extended-state observer, 1/s; with it e, ck and k are empty. None: no such.
        input_scale: kappa > 0, weight of z_2 ... z_rho in V, for y and u in the units of `Model`; 1 is the
            paper's law.
    """

    c: tuple[float, ...]
    e: tuple[float, ...]
    ck: tuple[float, ...]
    k: tuple[float, ...]
    compensator: bool = True
    matched: bool = False
    input_scale: float = 1.0
    braking: float | None = None
    observer: float | None = None

    @property
    def by_kind(self) -> dict[str, tuple[float, ...]]:
        """Each list by its name, in the order of the parameter vector."""
        return {"c": self.c, "e": self.e, "ck": self.ck, "k": self.k}


@dataclass(frozen=True)
class Simulation:
    """The run that a model file describes.

    Attributes:
        x0: n initial states, or the physical ones of `Model.start`.
        horizon: length of the run, s.
        output_step: distance of output instants, s.
        sample_time: hold time of the sampled controller, s.
    """

    x0: tuple[float, ...]
    horizon: float
    output_step: float
    sample_time: float


_V = real_symbol("v")


@dataclass(frozen=True)
class Channel:
    """One output of the actuator: ``clip(offset + slope v, lower, upper)``, in parameters.

    Attributes:
        symbol: its name in the plant's equations.
        offset: value at v = 0.
        slope: gain on v.
        lower: least value.
        upper: greatest value.
        unit: physical unit.
        about: one line for the reader.
        of: what the slope multiplies, v unless it is the output of a valve with a dead zone or a lag.
        expression: its value in full, where it is more than that clipped line: the valve's own output.
    """

    symbol: sp.Symbol
    offset: sp.Expr
    slope: sp.Expr
    lower: sp.Expr
    upper: sp.Expr
    unit: str
    about: str
    of: sp.Symbol = _V
    expression: sp.Expr | None = None

    @property
    def value(self) -> sp.Expr:
        """What it delivers (10)."""
        if self.expression is not None:
            return self.expression
        return sp.Max(self.lower, sp.Min(self.offset + self.slope * self.of, self.upper))


@dataclass(frozen=True)
class ExtraState:
    """A state of the simulated plant that the design does not have; it starts at zero.

    Attributes:
        symbol: ``x_{n+1}`` and so on.
        rate: its rate, a function of the plant's states, of what the actuator delivers, of t and parameters.
        unit: physical unit.
        about: one line for the reader.
    """

    symbol: sp.Symbol
    rate: sp.Expr
    unit: str
    about: str


@dataclass(frozen=True)
class Start:
    """How the physical states that a run starts from give the states of the simulated plant.

    Attributes:
        variables: physical states; the expression of each is its value in the plant's states.
        required: how many of them a run must be given; the others start at 0.
        states: plant state -> its value in the physical states and the plant's parameters.
    """

    variables: tuple[Equation, ...]
    required: int
    states: Mapping[sp.Symbol, sp.Expr]


@dataclass(frozen=True)
class Demand:
    """What the physics presumes of its parameters: an expression of them that is greater than 0.

    Attributes:
        parameter: the parameter at fault where it is not.
        expression: of parameters.
        what: what is wrong where it is not; empty where the parameter's own value says so.
    """

    parameter: sp.Symbol
    expression: sp.Expr
    what: str = ""


@dataclass(frozen=True)
class Model:
    """The whole input of a derivation.

    Attributes:
        name: folder under ``generated/``.
        title: one line for people.
        source: where the model and its numbers come from.
        parameters: symbols of the plant with their defaults, in the model file's order.
        plant: the plant of the design.
        limit: what bounds the actuator on either side, u_M of (10): a parameter, or the nearer of two.
        reference: y_r as a function of t and parameters.
        gains: default gains.
        simulation: default run.
        disturbance_bound: D_max of (9), or None when it is not known.
        y_range: least and greatest y for which sigma is known not to vanish, or None if not stated.
        y_unit: unit of the output.
        u_unit: unit of the input.
        measures: what these units are in SI units.
        constants: named coefficients that the plant's expressions use, such as d1 and b0 of a joint (8).
        extras: states of the simulated plant beyond the design's.
        channels: the actuator's outputs; the first is u. Empty: only u, within ``limit``.
        reported: further named signals of the plant, such as muscle pressures.
        demands: what the physics presumes of its parameters, the controller's and the plant's own.
        start: the physical states that a run starts from; None: those of the plant class.
        chosen: what keys of the design came to, one line each.
        design: row of `pmjoint_derive.derivation.DESIGNS`.
        segment: parameters of ``reference`` that change from break point to break point; see `segment`.
        transformation: rates of physical states and the design's coordinates in them, for the reader.
        chain: key of the actuator, the sensor or the clock -> its parameter, such as ``lower``, ``upper``,
            ``dead_zone`` and ``lag``, on which equations depend.
        adaptation: what the controller does not know; None: nothing.
    """

    name: str
    title: str
    source: str
    parameters: tuple[Parameter, ...]
    plant: Plant
    limit: sp.Expr
    reference: sp.Expr
    gains: Gains
    simulation: Simulation
    disturbance_bound: float | None = None
    y_range: tuple[float, float] | None = None
    y_unit: str = field(default="rad")
    u_unit: str = field(default="V")
    measures: Measures = field(default_factory=Measures)
    constants: tuple[Equation, ...] = ()
    extras: tuple[ExtraState, ...] = ()
    channels: tuple[Channel, ...] = ()
    reported: tuple[Equation, ...] = ()
    demands: tuple[Demand, ...] = ()
    start: Start | None = None
    chosen: tuple[str, ...] = ()
    design: str = "backstepping"
    segment: tuple[sp.Symbol, ...] = ()
    chain: Mapping[str, sp.Symbol] = field(default_factory=dict)
    transformation: tuple[Equation, ...] = ()
    adaptation: Adaptation | None = None

    @property
    def least_limit(self) -> sp.Expr:
        """The least |u| of the actuator's two limits."""
        u = self.actuator[0]
        return u.upper if u.upper == -u.lower else sp.Min(-u.lower, u.upper)

    @property
    def limits(self) -> tuple[sp.Expr, sp.Expr]:
        """Lower and upper limit of what the valve is told."""
        if "lower" in self.chain:
            return self.chain["lower"], self.chain["upper"]
        return -self.limit, self.limit

    @property
    def dead_zone(self) -> sp.Expr | None:
        """Width of the valve's dead zone, which the controller inverts; None: it has none."""
        return self.chain.get("dead_zone")

    @property
    def lag(self) -> sp.Expr | None:
        """Time constant of the actuator, the plant's alone, s; None: it has none."""
        return self.chain.get("lag")

    @property
    def actuator(self) -> tuple[Channel, ...]:
        """The actuator's outputs, u first (10)."""
        zero, one = sp.Integer(0), sp.Integer(1)
        lower, upper = self.limits
        u = Channel(real_symbol("u"), zero, one, lower, upper, self.u_unit, "applied input sat(v)")
        return self.channels or (u,)
