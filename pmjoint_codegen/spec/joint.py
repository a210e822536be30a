"""``[joint]``: the physical joint in place of ``[plant]``, and what a design keeps of it.

Its numbers become parameters of the model, settable at run time like any other; its expressions come from
`pmjoint_derive.joint`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import sympy as sp
from pydantic import BeforeValidator, Field

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.spec.expressions import parse
from pmjoint_codegen.spec.tables import Expression, ParameterSpec, Range, Table
from pmjoint_derive import OutsideClassError, Parameter, parameter_symbol
from pmjoint_derive.joint import KEEP, LAG, POSITIVE, Joint, check_keep, reduce_joint

# name -> unit and meaning where the file gives a bare number
SYMBOLS: Mapping[str, tuple[str, str]] = {
    "J": ("kg m^2", "moment of inertia"),
    "b_v": ("N m s/rad", "viscous damping"),
    "r": ("m", "pulley radius"),
    "l0": ("m", "nominal muscle length"),
    "eps0": ("1", "contraction at rest"),
    "C1": ("m^2", "muscle constant (2)"),
    "C2": ("m^2", "muscle constant (2)"),
    "C3": ("m^2", "muscle constant (2)"),
    "C4": ("N", "muscle constant (2); cancels"),
    "k0": ("Pa/V", "base pressure per volt (4)"),
    "u0": ("V", "base voltage (4)"),
    "k_u": ("Pa/V", "pressure difference per volt (4)"),
    "P_max": ("Pa", "supply pressure"),
    LAG: ("s", "time constant of the pressures"),
}


def _as_line(value: object) -> object:
    """Take a bare number for a line with that value."""
    return (
        {"value": float(value)} if isinstance(value, int | float) and not isinstance(value, bool) else value
    )


Quantity = Annotated[ParameterSpec, BeforeValidator(_as_line)]
_NUMBER = 'a number, or a line such as { value = 0.05, unit = "kg m^2" }'


class JointSpec(Table):
    """``[joint]``: (1)-(4); quantities in SI units."""

    keep: tuple[str, ...] = Field(default=(), description=f"a list of {', '.join(KEEP)}")
    J: Quantity = Field(description=_NUMBER)
    b_v: Quantity = Field(description=_NUMBER)
    r: Quantity = Field(description=_NUMBER)
    l0: Quantity = Field(description=_NUMBER)
    eps0: Quantity = Field(description=_NUMBER)
    C1: Quantity = Field(description=_NUMBER)
    C2: Quantity = Field(description=_NUMBER)
    C3: Quantity = Field(description=_NUMBER)
    C4: Quantity = Field(description=_NUMBER)
    k0: Quantity = Field(description=_NUMBER)
    u0: Quantity = Field(description=_NUMBER)
    k_u: Quantity = Field(description=_NUMBER)
    P_max: Quantity | None = Field(default=None, description=_NUMBER)
    tau: Quantity | None = Field(default=None, description=_NUMBER)
    disturbance: Expression = Field(
        default="0", description="a torque in N m, an expression of t and parameters"
    )
    disturbance_bound: float | None = Field(
        default=None, ge=0, allow_inf_nan=False, description="a finite number, 0 or greater"
    )
    range: Range | None = Field(
        default=None, description="a list of two finite numbers, least and greatest y of the design"
    )

    @property
    def order(self) -> int:
        """Order of the design's plant: three with a kept lag, two without."""
        return 3 if "pressure_lag" in self.keep else 2


def joint_parameters(spec: JointSpec) -> dict[str, ParameterSpec]:
    """The joint's numbers as parameters; P_max is twice the base pressure where it is not given."""
    lines: dict[str, Any] = {name: getattr(spec, name) for name in SYMBOLS}
    if lines["P_max"] is None:
        twice = 2 * spec.k0.value * spec.u0.value
        lines["P_max"] = ParameterSpec(value=twice, about="supply pressure: twice the base pressure")
    return {name: _labelled(name, line) for name, line in lines.items() if line is not None}


def _labelled(name: str, line: ParameterSpec) -> ParameterSpec:
    """A line with the usual unit and meaning where the file gives none."""
    unit, about = SYMBOLS[name]
    given = line.model_fields_set
    return ParameterSpec(
        value=line.value, unit=line.unit if "unit" in given else unit, about=line.about or about
    )


def check_joint(spec: JointSpec, where: str) -> None:
    """Hold a joint's numbers to what (1)-(4) presume, and `keep` to what a design can keep.

    `keep` comes first: the lengths of gains and states follow from it.

    Raises:
        ModelError: naming file, key, what is wrong and what is allowed.
    """
    try:
        check_keep(spec.keep, lagged=spec.tau is not None)
    except OutsideClassError as error:
        raise ModelError(error.what, where=f"{where}: {error.key}", remedy=error.remedy) from error
    lines = joint_parameters(spec)
    for name in POSITIVE:
        if name in lines and lines[name].value <= 0:
            raise ModelError(
                f"is {lines[name].value:g}",
                where=f"{where}: joint.{name}",
                remedy="allowed: a number greater than 0",
            )
    base = spec.k0.value * spec.u0.value
    if base >= lines["P_max"].value:
        raise ModelError(
            f"the base pressure k0*u0 = {base:g} Pa is not below P_max = {lines['P_max'].value:g} Pa",
            where=f"{where}: joint.u0",
            remedy="allowed: a base pressure between 0 and P_max",
        )


def to_joint(spec: JointSpec, parameters: tuple[Parameter, ...], limit: sp.Symbol, where: str) -> Joint:
    """Reduce the joint to the plant class.

    Args:
        spec: the table.
        parameters: all parameters of the model, the joint's among them.
        limit: symbol of the actuator's limit.
        where: file that a message begins with.

    Raises:
        ModelError: for a bad expression.
        OutsideClassError: for physics that no design can keep.
    """
    symbols = {item.name: item.symbol for item in parameters} | {"t": parameter_symbol("t")}
    torque = parse(spec.disturbance, symbols, f"{where}: joint.disturbance", kinks=True)
    return reduce_joint(spec.keep, lagged=spec.tau is not None, vartheta=torque, limit=limit)
