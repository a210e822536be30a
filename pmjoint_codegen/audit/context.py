"""What the printed equations are checked against, and tables of what each printed symbol stands for.

Every quantity is an expression of *primitive* symbols: the plant's and the controller's states, the
reference with its derivatives, the disturbance d, the applied input u (free: no saturation is assumed), the
law's output v (free, or the derived law), gains and parameters. Rates come from the derivation, so
``dot(q)`` of any printed q is a chain rule, and an identity that holds here holds along every trajectory of
the closed loop, whatever u is.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce
from operator import mul
from types import MappingProxyType
from typing import Any

import sympy as sp

from pmjoint_codegen.audit.joint import joint_symbols
from pmjoint_codegen.audit.notation import Scope, value
from pmjoint_codegen.audit.paper import DESIGN, JOINT, Printed
from pmjoint_derive import Derivation, Signals, real_symbol
from pmjoint_derive.filters import filter_matrix, shift_matrix
from pmjoint_derive.lyapunov import error_function, lyapunov_function
from pmjoint_derive.lyapunov_matrix import lyapunov_matrix
from pmjoint_derive.units import Unit


@dataclass(frozen=True)
class Context:
    """The derivation that an audit compares with, and the printed paper.

    Attributes:
        paper: displays by number.
        derivation: of the paper's model: n = rho = 2.
        P: solution of ``P A0 + A0' P = -2 I``, 2 x 2, in terms of the filter gains.
    """

    paper: Mapping[str, Printed]
    derivation: Derivation
    P: sp.ImmutableMatrix = field(init=False)

    def __post_init__(self) -> None:
        """Solve the Lyapunov equation once."""
        object.__setattr__(self, "P", lyapunov_matrix(self.signals))

    @property
    def signals(self) -> Signals:
        """Symbols of the derivation."""
        return self.derivation.signals

    def scope(self, name: str) -> Scope:
        """The table of symbols for a part of the paper."""
        s = self.signals
        known = {"u": s.u, "y": s.y, "x_1": s.x[0], "x_2": s.x[1], "d": disturbance_symbol()}
        known |= {"b_0": real_symbol("b0"), "d_1": real_symbol("d1")}
        known |= {"dot(x_1)": real_symbol("x1_dot"), "dot(x_2)": real_symbol("x2_dot")}
        if name == DESIGN:
            return DesignScope(self)
        if name == JOINT:
            return MappingProxyType({**joint_symbols(), **known})
        return MappingProxyType(
            {letter: sp.Symbol(f"{letter}_Young", positive=letter == "d_1") for letter in ("a", "b", "d_1")}
        )

    def expand(self, item: Any, law: bool = False) -> Any:
        """An expression or matrix in primitive symbols.

        The compensator is on, and the input scale, which the paper does not have, is 1.

        Args:
            item: expression in any names of the derivation.
            law: put the derived law in place of v.
        """
        s = self.signals
        keep = frozenset({s.u, disturbance_symbol(), *s.y_r} | (set() if law else {s.v}))
        measured = {s.y: s.x[0], s.compensator: sp.Integer(1), s.input_scale: sp.Integer(1)}

        def expanded(entry: sp.Expr) -> sp.Expr:
            return self.derivation.equations.expand(entry, keep).xreplace(measured)

        return item.applyfunc(expanded) if isinstance(item, sp.MatrixBase) else expanded(sp.sympify(item))

    def rate(self, item: Any) -> Any:
        """Time derivative of an expression or matrix along the loop, in primitive symbols."""
        primitive = self.expand(item)
        rates = self._rates()
        zero = primitive * 0 if isinstance(primitive, sp.MatrixBase) else sp.Integer(0)
        return sum((sp.diff(primitive, state) * rate for state, rate in rates.items()), zero)

    def _rates(self) -> Mapping[sp.Symbol, sp.Expr]:
        s = self.signals
        states = (*s.x, *s.controller_state)
        rates = {state: self.expand(self.derivation.equations[f"{state}_dot"].expression) for state in states}
        return rates | dict(zip(s.y_r, s.y_r[1:], strict=False))

    def value(self, text: str, law: bool = False) -> Any:
        """A printed expression of the design part, in primitive symbols.

        Raises:
            KeyError: an unknown symbol.
            TypeError: sizes that do not fit.
        """
        return self.expand(value(text, self.scope(DESIGN)), law)

    def unit(self, text: str) -> Unit:
        """Unit of a printed product of powers of the design part, such as ``z_1**2``."""
        powers = value(text, self.scope(DESIGN)).as_powers_dict()
        factors = (self.derivation.units.of(base) ** int(power) for base, power in powers.items())
        return reduce(mul, factors, Unit({}))

    def numbers(self) -> Mapping[sp.Symbol, sp.Rational]:
        """The example's parameters and gains."""
        values = {item.symbol: item.value for item in self.derivation.model.parameters}
        values |= self.derivation.gain_values
        return {symbol: sp.Rational(repr(number)) for symbol, number in values.items()}


def disturbance_symbol() -> sp.Symbol:
    """The symbol of d, which enters the second state."""
    return real_symbol("D2")


class DesignScope(Mapping[str, Any]):
    """Symbols from (9) on; derivatives are computed when they are asked for."""

    def __init__(self, context: Context) -> None:
        """Take the derivation."""
        self._context = context
        self._known = _design_table(context)

    def __getitem__(self, name: str) -> Any:
        """What a printed name stands for; raises KeyError when nothing is known of it."""
        if name in self._known:
            return self._known[name]
        node = ast.parse(name, mode="eval").body
        if isinstance(node, ast.Call):
            arguments = [ast.unparse(argument) for argument in node.args]
            match ast.unparse(node.func):
                case "dot":
                    return self._context.rate(value(arguments[0], self))
                case "ddot":
                    return self._context.rate(self[f"dot({arguments[0]})"])
                case "partial":
                    return self._partial(*arguments)
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        """Names in the table."""
        return iter(self._known)

    def __len__(self) -> int:
        """Number of names in the table."""
        return len(self._known)

    def __contains__(self, name: object) -> bool:
        """Whether a name is in the table; derivatives are not, they are computed."""
        return name in self._known

    def _partial(self, of: str, by: str) -> Any:
        """Derivative of one quantity by another; by a column it is a row."""
        function = self._context.expand(value(of, self))
        argument = self._context.expand(value(by, self))
        if isinstance(argument, sp.MatrixBase):
            return sp.Matrix([[sp.diff(function, entry) for entry in argument]])
        return sp.diff(function, argument)


def _design_table(context: Context) -> Mapping[str, Any]:
    s, P, d = context.signals, context.P, disturbance_symbol()
    n, V_epsilon = len(s.x), error_function(s, P)
    table: dict[str, Any] = {
        "y": s.y,
        "u": s.u,
        "v": s.v,
        "t": s.t,
        "d": d,
        "Delta_u": s.du,
        "b_0": real_symbol("b0"),
        "d_1": real_symbol("d1"),
        "theta_1": real_symbol("d1"),
        "u_M": real_symbol("u_max"),
        "D_max": sp.Symbol("D_max", positive=True),
        "y_r": s.y_r[0],
        "x": sp.Matrix(s.x),
        "xi": sp.Matrix(s.xi),
        "lamda": sp.Matrix(s.lambda_),
        "v_0": sp.Matrix(s.lambda_),
        "Xi_A": sp.Matrix(s.Xi).T,
        "Xi_A2": s.Xi[1][0],
        "epsilon": sp.Matrix(s.epsilon),
        "hat(x)": sp.Matrix([real_symbol(f"x_hat{i}") for i in range(1, n + 1)]),
        "A": shift_matrix(n),
        "A_0": filter_matrix(s),
        "k": sp.Matrix(s.k),
        "I": sp.eye(n),
        "E_1": sp.eye(n)[:, 0],
        "E_2": sp.eye(n)[:, 1],
        "D": sp.Matrix([0, d]),
        "Phi_1": sp.Matrix([0, s.y]),
        "Theta": sp.Matrix([real_symbol("b0"), real_symbol("d1")]),
        "omega": sp.Matrix([real_symbol("v0_2"), s.Xi[1][0]]),
        "bar(omega)": sp.Matrix([0, s.Xi[1][0]]),
        "P": P,
        "norm(P)": spectral_norm(),
        "lamda_max(P)": spectral_norm(),
        "V_epsilon": V_epsilon,
        "V_1": lyapunov_function(s, V_epsilon, steps=1),
        "V_2": lyapunov_function(s, V_epsilon),
    }
    for i in range(1, n + 1):
        table |= {f"x_{i}": s.x[i - 1], f"hat(x_{i})": real_symbol(f"x_hat{i}"), f"xi_{i}": s.xi[i - 1]}
        table |= {
            f"epsilon_{i}": s.epsilon[i - 1],
            f"r_{i}": s.r[i - 1],
            f"z_{i}": s.z[i - 1],
            f"k_{i}": s.k[i - 1],
        }
        table |= {f"C_{i}": s.c[i - 1], f"c_{i}": s.c[i - 1], f"e_{i}": s.e[i - 1]}
        table |= {f"C_k{i}": s.ck[i - 1], f"c_k{i}": s.ck[i - 1]}
    table |= {f"v_0_{i}": real_symbol(f"v0_{i}") for i in (1, 2, 3)} | {"alpha_1": s.alpha[0]}
    return MappingProxyType(table)


def spectral_norm() -> sp.Symbol:
    """The largest eigenvalue of P, which is its spectral norm, since P is symmetric and positive."""
    return sp.Symbol("lambda_P", positive=True)
