"""From a validated model file to the record that the derivation takes.

Expressions become SymPy over the symbols allowed in their place; numbers are checked against the rules of the
design and of the plant class.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.design import chosen, gains_of
from pmjoint_codegen.modelfile.expressions import parse
from pmjoint_codegen.modelfile.joint import (
    COLUMNS,
    check_columns,
    check_joint,
    converted,
    joint_parameters,
    to_joint,
)
from pmjoint_codegen.modelfile.schema import ModelSpec, PlantSpec
from pmjoint_codegen.modelfile.soundness import check_model
from pmjoint_codegen.modelfile.units import ANY, Scales, Wanted
from pmjoint_codegen.values import COMPENSATOR, GAINS, INPUT_SCALE, check_values
from pmjoint_derive import Gains, Model, OutsideClassError, Parameter, Plant, Simulation, real_symbol

Symbols = Mapping[str, sp.Symbol]


def to_derive(spec: ModelSpec, where: str = "") -> Model:
    """Build the record that the derivation takes.

    Args:
        spec: a validated model file.
        where: file at the start of a message; by default the model's name.

    Raises:
        ModelError: a bad expression, a value that breaks a rule of the design, or a plant outside the class.
    """
    where = where or f"model {spec.name}"
    parameters = _parameters(spec, where)
    known = {item.name: item.symbol for item in parameters}
    try:
        physics = _physics(spec, parameters, where)
        gains = gains_of(spec, physics, parameters, where)
        _check_values(spec, gains, parameters, where)
        model = Model(
            name=spec.name,
            title=spec.title,
            source=spec.source,
            parameters=parameters,
            limit=known[spec.actuator.limit],
            reference=parse(spec.simulation.reference, _with(known, "t"), f"{where}: simulation.reference"),
            gains=gains,
            chosen=chosen(spec.design, gains),
            simulation=Simulation(**spec.simulation.model_dump(exclude={"reference"})),
            y_unit=spec.units.y,
            u_unit=spec.units.u,
            y_range=spec.y_range,
            **physics,
        )
    except OutsideClassError as error:
        raise ModelError(error.what, where=f"{where}: {error.key}", remedy=error.remedy) from error
    check_model(model, where)
    return model


def _parameters(spec: ModelSpec, where: str) -> tuple[Parameter, ...]:
    """All parameters: as written beside ``[plant]``, whose author keeps units consistent; else in SI."""
    if spec.joint is None:
        return tuple(
            Parameter(name, line.value, line.unit, line.about) for name, line in spec.parameters.items()
        )
    scales = Scales(where)
    check_columns({"y": spec.units.y, "u": spec.units.u}, scales)
    of_joint = joint_parameters(spec.joint, scales)
    check_joint({item.name: item for item in of_joint}, where)
    wanted = {spec.actuator.limit: Wanted(COLUMNS["u"], "mV")}
    return (
        *of_joint,
        *(
            converted(name, line, scales, f"parameters.{name}", wanted.get(name, ANY))
            for name, line in spec.parameters.items()
        ),
    )


def _physics(spec: ModelSpec, parameters: tuple[Parameter, ...], where: str) -> dict[str, Any]:
    """The plant as ``[plant]`` states it, or reduced from ``[joint]`` with the omitted physics."""
    known = {item.name: item.symbol for item in parameters}
    if spec.plant is not None:
        return {
            "plant": _plant(spec.plant, known, where),
            "disturbance_bound": spec.plant.disturbance_bound,
        }
    assert spec.joint is not None  # `validate` demands one of the two
    joint = to_joint(spec.joint, parameters, known[spec.actuator.limit], where)
    return {**vars(joint), "disturbance_bound": spec.joint.disturbance_bound}


def _with(known: Symbols, *names: str) -> Symbols:
    return {name: real_symbol(name) for name in names} | dict(known)


def _plant(spec: PlantSpec, known: Symbols, where: str) -> Plant:
    """Parse the expressions of ``[plant]``, each over what it may depend on (11)."""
    n = spec.order
    of_output, of_state = _with(known, "y"), _with(known, "t", *(f"x{i}" for i in range(1, n + 1)))

    def column(key: str, texts: Iterable[str], symbols: Symbols) -> tuple[sp.Expr, ...]:
        return tuple(
            _parse(text, symbols, of_state, f"{where}: plant.{key}, entry {i}")
            for i, text in enumerate(texts, start=1)
        )

    return Plant(
        order=n,
        phi=column("phi", spec.phi or ("0",) * n, of_output),
        Phi=tuple(
            column(f"Phi, entry {i}", row, of_output) for i, row in enumerate(spec.Phi or ((),) * n, start=1)
        ),
        theta=column("theta", spec.theta, known),
        b=column("b", spec.b, known),
        sigma=_parse(spec.sigma, of_output, of_state, f"{where}: plant.sigma"),
        disturbance=tuple(
            parse(text, of_state, f"{where}: plant.disturbance, entry {i}", kinks=True)
            for i, text in enumerate(spec.disturbance or ("0",) * n, start=1)
        ),
    )


def _parse(text: str, allowed: Symbols, known: Symbols, where: str) -> sp.Expr:
    """Parse over `allowed`; expressions with the plant's states go to `Plant`, which gives the reason."""
    try:
        return parse(text, allowed, where)
    except ModelError:
        with suppress(ModelError):
            return parse(text, {**known, **allowed}, where)
        raise


def _check_values(spec: ModelSpec, gains: Gains, parameters: tuple[Parameter, ...], where: str) -> None:
    """Check the file's numbers against the rules for values set for one run."""
    values = {item.name: item.value for item in parameters}
    keys = {name: f"joint.{name}" for name in values}
    keys |= {name: f"parameters.{name}.value" for name in spec.parameters} | {
        "k": "design.k",
        COMPENSATOR: "design.compensator",
        INPUT_SCALE: "design.input_scale",
    }
    for kind in GAINS:
        names = kind.names(spec.order, spec.relative_degree)
        values |= dict(zip(names, gains.by_kind[kind.name], strict=True))
        keys |= {name: f"design.{kind.name}, entry {i}" for i, name in enumerate(names, start=1)}
    values |= {COMPENSATOR: float(gains.compensator), INPUT_SCALE: gains.input_scale}
    leading = spec.plant.b[0].strip() if spec.plant else ""
    check_values(
        values,
        n=spec.order,
        rho=spec.relative_degree,
        limit=spec.actuator.limit,
        leading=leading if leading in spec.parameters else None,
        where=where,
        key=lambda name: keys[name],
        scales={item.name: item.scale for item in parameters},
    )
