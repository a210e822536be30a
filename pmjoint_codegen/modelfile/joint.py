"""``[joint]``: the physical joint in place of ``[plant]``, and the physics that a design keeps.

Its numbers become parameters of the model, settable at run time like any other, in the unit that the file
gives them; the kernels take SI units. Its expressions come from `pmjoint_derive.joint`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated

import sympy as sp
from pydantic import BeforeValidator, Field, PlainValidator

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.expressions import parse
from pmjoint_codegen.modelfile.force_laws import FORCE_LAWS
from pmjoint_codegen.modelfile.muscle import (
    RADIUS,
    SIDES,
    is_paper_pair,
    law_of,
    muscle_lengths,
    own_name,
    own_values,
    to_muscles,
)
from pmjoint_codegen.modelfile.tables import Expression, ParameterSpec, Range, Table
from pmjoint_codegen.modelfile.units import Scales, Wanted
from pmjoint_codegen.values import SI, from_si, to_si
from pmjoint_derive import OutsideClassError, Parameter, real_symbol
from pmjoint_derive.balance import Balance
from pmjoint_derive.force import tensions
from pmjoint_derive.joint import KEEP, LAG, POSITIVE, Joint, check_keep, reduce_joint
from pmjoint_derive.muscle import paper_pair

# name -> SI unit, another common unit, and the meaning if the file states none
SYMBOLS: Mapping[str, tuple[str, str, str]] = {
    "J": ("kg m^2", "kg cm^2", "moment of inertia"),
    "b_v": ("N m s/rad", "N mm s/rad", "viscous damping"),
    "r": ("m", "mm", "pulley radius"),
    "l0": ("m", "mm", "nominal muscle length"),
    "eps0": ("1", "%", "contraction at rest"),
    "C1": ("m^2", "cm^2", "muscle constant (2)"),
    "C2": ("m^2", "cm^2", "muscle constant (2)"),
    "C3": ("m^2", "cm^2", "muscle constant (2)"),
    "C4": ("N", "kN", "muscle constant (2); cancels"),
    "k0": ("Pa/V", "bar/V", "base pressure per volt (4)"),
    "u0": ("V", "mV", "base voltage (4)"),
    "k_u": ("Pa/V", "bar/V", "pressure difference per volt (4)"),
    "P_max": ("Pa", "bar", "supply pressure"),
    LAG: ("s", "ms", "time constant of the pressures"),
}


def _as_line(value: object) -> object:
    """Take a bare number for a line with that value."""
    return (
        {"value": float(value)} if isinstance(value, int | float) and not isinstance(value, bool) else value
    )


def _arm(value: object) -> ParameterSpec | str:
    """Take a text for an expression, all else for a line."""
    return value if isinstance(value, str) else ParameterSpec.model_validate(_as_line(value))


Quantity = Annotated[ParameterSpec, BeforeValidator(_as_line)]
Arm = Annotated[ParameterSpec | str, PlainValidator(_arm)]
_NUMBER = 'a number, or a line such as { value = 0.05, unit = "kg m^2" }'
_ARM = 'a number, a line such as { value = 15, unit = "mm" }, or an expression of theta and parameters'
_OWN = "a table of the muscle's own values, such as { l0 = 0.2, C1 = 0.03 }"


class JointSpec(Table):
    """``[joint]``: (1)-(4); quantities in SI units, or in the unit beside them."""

    keep: tuple[str, ...] = Field(default=(), description=f"a list of {', '.join(KEEP)}")
    J: Quantity = Field(description=_NUMBER)
    b_v: Quantity = Field(description=_NUMBER)
    r: Quantity | None = Field(default=None, description=_NUMBER)
    r1: Arm | None = Field(default=None, description=_ARM)
    r2: Arm | None = Field(default=None, description=_ARM)
    l0: Quantity | None = Field(default=None, description=_NUMBER)
    eps0: Quantity | None = Field(default=None, description=_NUMBER)
    force: Expression | None = Field(
        default=None, description=f"an expression of P, eps and parameters, or {', '.join(FORCE_LAWS)}"
    )
    muscle1: dict[str, Quantity] = Field(default={}, description=_OWN)
    muscle2: dict[str, Quantity] = Field(default={}, description=_OWN)
    C1: Quantity | None = Field(default=None, description=_NUMBER)
    C2: Quantity | None = Field(default=None, description=_NUMBER)
    C3: Quantity | None = Field(default=None, description=_NUMBER)
    C4: Quantity | None = Field(default=None, description=_NUMBER)
    k0: Quantity = Field(description=_NUMBER)
    u0: Quantity = Field(description=_NUMBER)
    k_u: Quantity = Field(description=_NUMBER)
    P_max: Quantity | None = Field(default=None, description=_NUMBER)
    tau: Quantity | None = Field(default=None, description=_NUMBER)
    torque: Expression | None = Field(
        default=None, description="a torque in N m, an expression of theta and parameters"
    )
    friction: Expression = Field(
        default="0", description="a torque in N m, an expression of theta_dot and parameters"
    )
    disturbance: Expression = Field(
        default="0", description="a torque in N m, an expression of theta, theta_dot, t and parameters"
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


def joint_names(spec: JointSpec) -> tuple[str, ...]:
    """Names of the joint's parameters; P_max is one even if the file omits it."""
    return tuple(name for name in SYMBOLS if name == "P_max" or getattr(spec, name) is not None)


def check_kept(spec: JointSpec, where: str) -> None:
    """Check `keep` against what a design can keep; the lengths of gains and states follow from it.

    Raises:
        ModelError: naming file, key, what is wrong and what is allowed.
    """
    try:
        check_keep(spec.keep, lagged=spec.tau is not None, torque=spec.torque is not None)
    except OutsideClassError as error:
        raise ModelError(error.what, where=f"{where}: {error.key}", remedy=error.remedy) from error


def joint_parameters(spec: JointSpec, scales: Scales) -> tuple[Parameter, ...]:
    """The joint's numbers in SI units; P_max is twice the base pressure where it is not given.

    Raises:
        ModelError: for a unit of another dimension.
    """
    found = {
        name: _quantity(name, line, scales)
        for name in joint_names(spec)
        if (line := getattr(spec, name)) is not None
    }
    if "P_max" not in found:
        twice = 2 * found["k0"].value * found["u0"].value
        about = "supply pressure: twice the base pressure"
        found["P_max"] = Parameter("P_max", twice, SYMBOLS["P_max"][0], about)
    return tuple(found[name] for name in joint_names(spec))


def _quantity(name: str, line: ParameterSpec, scales: Scales) -> Parameter:
    """A line in SI units, with the usual unit and meaning where the file gives none."""
    unit, example, about = SYMBOLS[name]
    if "unit" not in line.model_fields_set:
        return Parameter(name, line.value, unit, line.about or about)
    return converted(name, line, scales, f"joint.{name}", Wanted(unit, example), about)


def own_parameters(spec: JointSpec, shared: Mapping[str, Parameter], scales: Scales) -> tuple[Parameter, ...]:
    """Each muscle's own values in SI units.

    Args:
        spec: the table.
        shared: the model's other parameters, with the values that both muscles have.
        scales: of the model file.

    Raises:
        ModelError: for a unit of another dimension, none beside a value in a unit other than those of SI, or
            a length that is not positive.
    """
    found = []
    for side in SIDES:
        for name, line in own_values(spec, side).items():
            usual = _usual(name, spec, shared)
            key = f"joint.r{side}" if name == RADIUS else f"joint.muscle{side}.{name}"
            item = _own(name, side, line, usual, shared.get(name), key, scales)
            if name in POSITIVE:
                _check_positive(item, f"{scales.where}: {key}")
            found.append(item)
    return tuple(found)


def _usual(name: str, spec: JointSpec, shared: Mapping[str, Parameter]) -> tuple[str, str, str]:
    """Unit, another common unit and meaning of a quantity of a muscle."""
    if name in SYMBOLS:
        return SYMBOLS[name]
    constant, common = law_of(spec).constants.get(name), shared.get(name)
    if constant is not None:
        return constant.unit, constant.example, constant.about
    return (common.unit, common.unit, common.about) if common else ("", "mm", name)


def _own(
    name: str,
    side: int,
    line: ParameterSpec,
    usual: tuple[str, str, str],
    common: Parameter | None,
    key: str,
    scales: Scales,
) -> Parameter:
    """One muscle's own value."""
    unit, example, about = usual
    about = f"{about}, muscle {side}"
    if "unit" in line.model_fields_set:
        return converted(own_name(name, side), line, scales, key, Wanted(unit, example), about)
    if common is not None and common.scale != SI:
        raise ModelError(
            f"has no unit, and {name} of both muscles is in {common.unit}",
            where=f"{scales.where}: {key}",
            remedy=f'write {name} = {{ value = {line.value:g}, unit = "{common.unit}" }}',
        )
    return Parameter(own_name(name, side), line.value, unit or "1", line.about or about)


def converted(
    name: str, line: ParameterSpec, scales: Scales, key: str, wanted: Wanted, about: str = ""
) -> Parameter:
    """A line of a joint's model in SI units, with its own unit for the reader.

    Raises:
        ModelError: for a unit of another dimension.
    """
    scale = scales.of(line.unit, f"{key}.unit", wanted) if "unit" in line.model_fields_set else SI
    return Parameter(name, to_si(line.value, scale), line.unit, line.about or about, scale)


def check_joint(parameters: Mapping[str, Parameter], where: str) -> None:
    """Check a joint's numbers against the assumptions of (1)-(4).

    Raises:
        ModelError: naming file, key, what is wrong and what is allowed.
    """
    for name in POSITIVE:
        if name in parameters:
            _check_positive(parameters[name], f"{where}: joint.{name}")
    base, supply = parameters["k0"].value * parameters["u0"].value, parameters["P_max"].value
    if base >= supply:
        raise ModelError(
            f"the base pressure k0*u0 = {base:g} Pa is not below P_max = {supply:g} Pa",
            where=f"{where}: joint.u0",
            remedy="allowed: a base pressure between 0 and P_max",
        )


def _check_positive(item: Parameter, where: str) -> None:
    if item.value <= 0:
        raise ModelError(
            f"is {from_si(item.value, item.scale):g}",
            where=where,
            remedy="allowed: a number greater than 0",
        )


def to_joint(
    spec: JointSpec, parameters: tuple[Parameter, ...], limits: tuple[sp.Expr, sp.Expr], where: str
) -> Joint:
    """Reduce the joint to the plant class.

    Args:
        spec: the table.
        parameters: all parameters of the model, the joint's among them.
        limits: lower and upper limit of u.
        where: file at the start of a message.

    Raises:
        ModelError: for a bad expression.
        OutsideClassError: for physics that no design can keep.
    """
    known = {item.name: item.symbol for item in parameters}
    muscles = None if is_paper_pair(spec) else to_muscles(spec, known, where)
    balance = Balance(
        paper_pair() if muscles is None else (muscles[0].pull, muscles[1].pull),
        torque=_torque("torque", spec.torque or "0", ("theta",), parameters, where),
        friction=_torque("friction", spec.friction, ("theta_dot",), parameters, where, kinks=True),
        disturbance=_torque(
            "disturbance", spec.disturbance, ("theta", "theta_dot", "t"), parameters, where, kinks=True
        ),
    )
    joint = reduce_joint(
        spec.keep, balance, lagged=spec.tau is not None, limits=limits, lengths=muscle_lengths(spec)
    )
    if muscles is None:
        return joint
    return replace(joint, reported=(*joint.reported, *tensions(muscles, law_of(spec).source)))


def _torque(
    key: str,
    text: str,
    signals: tuple[str, ...],
    parameters: tuple[Parameter, ...],
    where: str,
    *,
    kinks: bool = False,
) -> sp.Expr:
    """A torque over the signals that it may depend on, and parameters."""
    symbols = {name: real_symbol(name) for name in signals} | {item.name: item.symbol for item in parameters}
    return parse(text, symbols, f"{where}: joint.{key}", kinks=kinks, signals=signals)
