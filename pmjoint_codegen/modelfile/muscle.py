"""The two muscles of ``[joint]``: their law of force, their own values and their moment arms.

``force`` is an expression of P, eps and parameters, or the name of a law in `force_laws`, whose constants are
lines of ``[parameters]``. ``muscle1`` and ``muscle2`` give one muscle its own value of what the law uses:
``C1`` of muscle 1 is the parameter ``C1_muscle1``. (``C1_1`` would not do: ``b_1`` and ``theta_1`` are names
of the derivation, as ``r1`` is.) ``r1`` and ``r2`` are radii, then parameters ``r_muscle1`` and
``r_muscle2``, or moment arms as expressions of theta and parameters.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import sympy as sp

from pmjoint_codegen.errors import ModelError, did_you_mean, quoted
from pmjoint_codegen.modelfile.expressions import parse
from pmjoint_codegen.modelfile.force_laws import FORCE_LAWS, PAPER, ForceLaw
from pmjoint_codegen.modelfile.names import CONSTANTS, why_not
from pmjoint_codegen.modelfile.tables import ParameterSpec
from pmjoint_codegen.operations import functions
from pmjoint_derive import real_symbol
from pmjoint_derive.force import CONTRACTION, PRESSURE, Muscle, attached, split
from pmjoint_derive.joint import LENGTHS
from pmjoint_derive.muscle import ANGLE

if TYPE_CHECKING:
    from pmjoint_codegen.modelfile.joint import JointSpec

SIDES: Final = (1, 2)
OF_LAW: Final = ("C1", "C2", "C3", "C4")  # constants of (2), lines of [joint]
OF_MUSCLE: Final = ("l0", "eps0", *OF_LAW)  # quantities of [joint] that each muscle may have its own of
RADIUS: Final = "r"
SIGNALS: Final = (PRESSURE.name, CONTRACTION.name)  # of which a force is a function
FORCES: Final = ("F1", "F2")  # columns of a joint whose muscles are not those of the paper
_NAME = re.compile(r"\b[A-Za-z_]\w*")
_SIGNS: Final = {1: 1, 2: -1}  # muscle 1 pulls theta up


def own_name(name: str, side: int) -> str:
    """The parameter that is one muscle's own value."""
    return f"{name}_muscle{side}"


def own_values(joint: JointSpec, side: int) -> Mapping[str, ParameterSpec]:
    """What a muscle has of its own, its radius included: name -> line."""
    arm, table = (joint.r1, joint.muscle1) if side == 1 else (joint.r2, joint.muscle2)
    return {**({RADIUS: arm} if isinstance(arm, ParameterSpec) else {}), **table}


def own_names(joint: JointSpec) -> tuple[str, ...]:
    """Names of the parameters that are muscles' own values."""
    return tuple(own_name(name, side) for side in SIDES for name in own_values(joint, side))


def muscle_lengths(joint: JointSpec) -> tuple[str, ...]:
    """Parameters of the muscles that are lengths, and so greater than 0."""
    shared = (name for name in LENGTHS if getattr(joint, name) is not None)
    own = (own_name(name, side) for side in SIDES for name in own_values(joint, side) if name in LENGTHS)
    return (*shared, *own)


def is_paper_pair(joint: JointSpec) -> bool:
    """Whether both muscles are those of (2), (3), alike."""
    plain = joint.force in (None, PAPER) and joint.r1 is None and joint.r2 is None
    return plain and not joint.muscle1 and not joint.muscle2


def law_of(joint: JointSpec) -> ForceLaw:
    """The law of force: a named one, or the expression of the file with no constants of its own."""
    text = PAPER if joint.force is None else joint.force.strip()
    return FORCE_LAWS.get(text) or ForceLaw(text, "", {})


def law_lines(joint: JointSpec, given: Mapping[str, ParameterSpec]) -> dict[str, ParameterSpec]:
    """Lines of ``[parameters]`` for the constants of a named law, which state unit and meaning.

    Args:
        joint: the table.
        given: lines of the file; a constant that has none there, and no use, gets none.
    """
    found: dict[str, ParameterSpec] = {}
    for name, constant in law_of(joint).constants.items():
        line = given.get(name)
        if line is not None:
            unit = line.unit if "unit" in line.model_fields_set else constant.unit
            found[name] = ParameterSpec(value=line.value, unit=unit, about=line.about or constant.about)
        elif constant.value is not None and not _is_own_of_both(joint, name):
            found[name] = ParameterSpec(value=constant.value, unit=constant.unit, about=constant.about)
    return found


def check_muscles(joint: JointSpec, given: Mapping[str, ParameterSpec], where: str) -> None:
    """Check that each muscle has what its law needs, and that nothing is given in vain.

    Args:
        joint: the table.
        given: lines of ``[parameters]``.
        where: file at the start of a message.

    Raises:
        ModelError: for the first key at fault.
    """
    _check_law(joint, where)
    _check_complete(joint, given, where)
    _check_used(joint, where)
    for side in SIDES:
        _check_own(joint, given, side, where)
    for name in () if is_paper_pair(joint) else (*(() if joint.force is None else SIGNALS), *FORCES):
        if name in given:
            raise ModelError(
                "already names a quantity of the muscles",
                where=f"{where}: parameters.{name}",
                remedy="choose another name",
            )


def to_muscles(joint: JointSpec, symbols: Mapping[str, sp.Symbol], where: str) -> tuple[Muscle, Muscle]:
    """Both muscles, in their own values.

    Args:
        joint: a checked table.
        symbols: all parameters of the model by name.
        where: file at the start of a message.

    Raises:
        ModelError: for a bad expression.
        OutsideClassError: for a force that is not affine in P, or an arm without a closed integral.
    """
    first, second = (_muscle(joint, symbols, side, where) for side in SIDES)
    return first, second


def _muscle(joint: JointSpec, symbols: Mapping[str, sp.Symbol], side: int, where: str) -> Muscle:
    own = {real_symbol(name): real_symbol(own_name(name, side)) for name in own_values(joint, side)}
    of_force = {**symbols, **{symbol.name: symbol for symbol in own}}
    of_force |= {symbol.name: symbol for symbol in (PRESSURE, CONTRACTION)}
    place = f"{where}: joint.force"
    force = split(parse(law_of(joint).formula, of_force, place, signals=SIGNALS).xreplace(own))
    rest, length, radius = (own.get(real_symbol(name), real_symbol(name)) for name in ("eps0", "l0", RADIUS))
    key, text = f"joint.r{side}", joint.r1 if side == 1 else joint.r2
    arm: sp.Expr = radius
    if isinstance(text, str):
        known = {**symbols, ANGLE.name: ANGLE}
        arm = parse(text, known, f"{where}: {key}", signals=(ANGLE.name,))
    return attached(force, arm, rest, length, _SIGNS[side], key)


def _names(text: str) -> set[str]:
    """What an expression speaks of, its functions aside."""
    return set(_NAME.findall(text)) - {*functions(), *CONSTANTS}


def _is_own_of_both(joint: JointSpec, name: str) -> bool:
    arms = joint.r1 is not None and joint.r2 is not None
    return arms if name == RADIUS else all(name in own_values(joint, side) for side in SIDES)


def _check_law(joint: JointSpec, where: str) -> None:
    """Tell a misspelt name of a law from an expression."""
    text = law_of(joint).formula
    if joint.force is not None and PRESSURE.name not in _names(text):
        guess = did_you_mean(text, FORCE_LAWS)
        raise ModelError(
            f"{quoted(text)} is no law of force, nor an expression of the pressure P",
            where=f"{where}: joint.force",
            remedy=f"{guess}allowed: {', '.join(FORCE_LAWS)}, or an expression of P, eps and parameters",
        )


def _check_complete(joint: JointSpec, given: Mapping[str, ParameterSpec], where: str) -> None:
    law = law_of(joint)
    of_law = OF_LAW if law is FORCE_LAWS[PAPER] else ()
    for name in (RADIUS, "l0", "eps0", *of_law):
        if getattr(joint, name) is None and not _is_own_of_both(joint, name):
            raise ModelError(
                "is missing",
                where=f"{where}: joint.{name}",
                remedy=f"allowed: {type(joint).model_fields[name].description}",
            )
    for name, constant in law.constants.items():
        if constant.value is None and name not in given and not _is_own_of_both(joint, name):
            raise ModelError(
                f"is missing: force = {quoted(joint.force or PAPER)} needs it, {constant.about}",
                where=f"{where}: parameters.{name}",
                remedy=f'write {name} = {{ value = ..., unit = "{constant.unit}" }}',
            )


def _check_used(joint: JointSpec, where: str) -> None:
    """Refuse a quantity of the muscles that neither muscle uses, nor any other expression of the table."""
    of_law = _names(law_of(joint).formula)
    texts = (joint.r1, joint.r2, joint.torque, joint.friction, joint.disturbance)
    elsewhere = {name for text in texts if isinstance(text, str) for name in _names(text)}
    for name in (RADIUS, *OF_MUSCLE):
        used = name in of_law or name not in OF_LAW
        if getattr(joint, name) is None or name in elsewhere:
            continue
        if not used or _is_own_of_both(joint, name):
            why = "each has its own" if used else "force does not contain it"
            raise ModelError(
                f"is used by neither muscle: {why}", where=f"{where}: joint.{name}", remedy="drop it"
            )


def _check_own(joint: JointSpec, given: Mapping[str, ParameterSpec], side: int, where: str) -> None:
    """Check the names that a muscle gives its own values of."""
    shared = set(type(joint).model_fields) - set(OF_MUSCLE)
    allowed = sorted({"l0", "eps0"} | _names(law_of(joint).formula) - shared - {*SIGNALS})
    for name in joint.muscle1 if side == 1 else joint.muscle2:
        place = f"{where}: joint.muscle{side}.{name}"
        if name not in allowed:
            remedy = f"give r{side} in [joint]" if name == RADIUS else f"allowed: {', '.join(allowed)}"
            raise ModelError("is no quantity of this muscle", where=place, remedy=remedy)
        other = own_values(joint, 3 - side)
        if name not in other and not _has_common(joint, given, name):
            raise ModelError(
                f"is given, but muscle {3 - side} has no {name}",
                where=place,
                remedy=f"give it in muscle{3 - side} too, or {name} of both",
            )
    for name in own_values(joint, side):
        reason = why_not(own_name(name, side))
        if own_name(name, side) in given:
            reason = f"its parameter {own_name(name, side)} is in [parameters] too"
        if reason:
            raise ModelError(
                reason, where=f"{where}: joint.muscle{side}.{name}", remedy="choose another name"
            )


def _has_common(joint: JointSpec, given: Mapping[str, ParameterSpec], name: str) -> bool:
    constant = law_of(joint).constants.get(name)
    of_law = constant is not None and constant.value is not None
    return of_law or name in given or (name in OF_MUSCLE and getattr(joint, name) is not None)
