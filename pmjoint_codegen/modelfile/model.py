"""From a validated model file to the record that the derivation takes.

Expressions become SymPy over the symbols allowed in their place; numbers are checked against the rules of the
design and of the plant class.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

import sympy as sp

from pmjoint_codegen.chain import LIMIT, LINKS, chain_rules
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.bench import chain_names, chain_numbers
from pmjoint_codegen.modelfile.columns import (
    Columns,
    columns_of,
    in_column_units,
    in_unit_of_y,
    rescaling_of,
)
from pmjoint_codegen.modelfile.design import chosen, gains_of
from pmjoint_codegen.modelfile.estimates import with_adaptation
from pmjoint_codegen.modelfile.expressions import parse
from pmjoint_codegen.modelfile.joint import (
    check_joint,
    converted,
    joint_parameters,
    own_parameters,
    to_joint,
)
from pmjoint_codegen.modelfile.load import check_alone, check_load, is_loaded, load_wanted, with_load
from pmjoint_codegen.modelfile.muscle import law_of
from pmjoint_codegen.modelfile.schema import ModelSpec, PlantSpec, check_degree
from pmjoint_codegen.modelfile.soundness import check_model
from pmjoint_codegen.modelfile.system import to_system
from pmjoint_codegen.modelfile.units import ANY, Scales, Wanted
from pmjoint_codegen.reference.command import DATA
from pmjoint_codegen.reference.segments import degrees
from pmjoint_codegen.values import (
    COMPENSATOR,
    FILTER_GAINS,
    GAINS,
    INPUT_SCALE,
    OBSERVER,
    check_rules,
    check_values,
)
from pmjoint_derive import Gains, Model, OutsideClassError, Parameter, Plant, Simulation, real_symbol
from pmjoint_derive.derivation import DESIGNS
from pmjoint_derive.rescaling import rescaled
from pmjoint_derive.segment import segment_reference, segment_symbols
from pmjoint_derive.units import Measures

Symbols = Mapping[str, sp.Symbol]
_UNITS = {"u": "V", "u/s": "V/s", "y": "rad", "s": "s", "1/s": "1/s", "1": "1"}  # of a joint's bench


def to_derive(spec: ModelSpec, where: str = "") -> Model:
    """Build the record that the derivation takes.

    Args:
        spec: a validated model file.
        where: file at the start of a message; by default the model's name.

    Raises:
        ModelError: a bad expression, a value that breaks a rule of the design, or a plant outside the class.
    """
    where = where or f"model {spec.name}"
    check_load(spec, where)
    columns = None if spec.plant is not None else columns_of(spec, Scales(where))
    parameters = _parameters(spec, columns, where)
    known = {item.name: item.symbol for item in parameters}
    measures = Measures() if columns is None else columns.measures
    try:
        physics = _physics(spec, parameters, columns, where)
        if is_loaded(spec):
            physics["plant"] = with_load(physics["plant"], where)
        rho = physics["plant"].rho
        DESIGNS[spec.design.law].signals_for(physics["plant"], None)  # refuses what the law does not cover
        if spec.relative_degree is None:
            check_degree(spec, rho, where)
        gains = gains_of(spec, physics, parameters, measures, where)
        _check_values(spec, rho, gains, parameters, where)
        model = Model(
            name=spec.name,
            title=spec.title,
            source=spec.source,
            parameters=parameters,
            limit=_limit(spec, known),
            chain={key: known[name] for key, name in chain_names(spec).items() if key != LIMIT},
            **_reference(spec, rho, parameters, columns, where),
            gains=gains,
            chosen=chosen(spec.design, gains, measures),
            simulation=Simulation(
                **spec.simulation.model_dump(exclude={"reference", "delay_samples", "jitter"})
            ),
            y_unit=spec.units.y,
            u_unit=spec.units.u,
            measures=measures,
            y_range=spec.y_range,
            design=spec.design.law,
            **physics,
        )
    except OutsideClassError as error:
        raise ModelError(error.what, where=f"{where}: {error.key}", remedy=error.remedy) from error
    if is_loaded(spec):
        check_alone(model, where, spec.physics_table)
    check_model(model, where, spec.physics_table)
    return with_adaptation(model, spec, where)


def _reference(
    spec: ModelSpec, rho: int, parameters: tuple[Parameter, ...], columns: Columns | None, where: str
) -> dict[str, Any]:
    """The reference as an expression; of the parameters of its segment where it is data."""
    if spec.simulation.reference == DATA:
        sizes = degrees(rho)
        return {"reference": segment_reference(*sizes), "segment": segment_symbols(*sizes)}
    known = {item.name: item.symbol for item in parameters}
    found = parse(spec.simulation.reference, _with(known, "t"), f"{where}: simulation.reference")
    return {"reference": found if columns is None else in_unit_of_y(found, parameters, columns)}


def _limit(spec: ModelSpec, known: Symbols) -> sp.Expr:
    """u_M: the limit, or the nearer one of the two."""
    names = chain_names(spec)
    if LIMIT in names:
        return known[names[LIMIT]]
    return sp.Min(-known[names["lower"]], known[names["upper"]])


def _parameters(spec: ModelSpec, columns: Columns | None, where: str) -> tuple[Parameter, ...]:
    """All parameters: as written beside ``[plant]``, whose author keeps units consistent; else in SI.

    Those of the actuator and the sensor are in the units of u and y.
    """
    if columns is None:
        return tuple(Parameter(name, line.value, line.unit, line.about) for name, line in spec.lines.items())
    found = _of_system(spec, columns.scales) if spec.system is not None else _of_joint(spec, columns.scales)
    return in_column_units(found, spec, columns)


def _of_joint(spec: ModelSpec, scales: Scales) -> tuple[Parameter, ...]:
    """The parameters of a joint in SI units."""
    assert spec.joint is not None
    of_joint = joint_parameters(spec.joint, scales)
    check_joint({item.name: item for item in of_joint}, scales.where)
    names = chain_names(spec)
    wanted = {name: Wanted(item.unit, item.example) for name, item in law_of(spec.joint).constants.items()}
    wanted |= {
        names[link.key]: Wanted(_UNITS[link.unit], _UNITS[link.unit].replace("V", "mV"))
        for link in LINKS
        if link.key in names
    } | load_wanted(spec)
    others = (
        converted(name, line, scales, f"parameters.{name}", wanted.get(name, ANY))
        for name, line in spec.lines.items()
    )
    shared = (*of_joint, *others)
    return (*shared, *own_parameters(spec.joint, {item.name: item for item in shared}, scales))


def _of_system(spec: ModelSpec, scales: Scales) -> tuple[Parameter, ...]:
    """The parameters of a system in SI units; limits have the dimension of the stated unit of u."""
    names, units = chain_names(spec), {"s": "s", "1/s": "1/s"}
    units |= {key: unit for key, unit in dict(spec.units).items() if key in spec.units.model_fields_set}
    wanted = {
        names[link.key]: Wanted(units[link.unit], units[link.unit])
        for link in LINKS
        if link.key in names and link.unit in units
    } | load_wanted(spec)
    return tuple(
        converted(name, line, scales, f"parameters.{name}", wanted.get(name, ANY))
        for name, line in spec.lines.items()
    )


def _physics(
    spec: ModelSpec, parameters: tuple[Parameter, ...], columns: Columns | None, where: str
) -> dict[str, Any]:
    """The plant as ``[plant]`` states it, or reduced from SI units to those of the columns."""
    if spec.plant is not None:
        plant = _plant(spec.plant, {item.name: item.symbol for item in parameters}, where)
        return {"plant": plant, "disturbance_bound": spec.plant.disturbance_bound}
    assert columns is not None  # `validate` demands one of the three tables
    found = (
        to_system(spec.system, parameters, spec.units.y, where)
        if spec.system is not None
        else _joint(spec, parameters, where)
    )
    bound = {"disturbance_bound": spec.physics.disturbance_bound}
    return rescaled(found, rescaling_of(spec, found, columns)) | bound


def _joint(spec: ModelSpec, parameters: tuple[Parameter, ...], where: str) -> dict[str, Any]:
    """The joint in SI units."""
    assert spec.joint is not None
    known, names = {item.name: item.symbol for item in parameters}, chain_names(spec)
    limit = known[names[LIMIT]] if LIMIT in names else None
    limits = (-limit, limit) if limit is not None else (known[names["lower"]], known[names["upper"]])
    return dict(vars(to_joint(spec.joint, parameters, limits, where)))


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


def _check_values(
    spec: ModelSpec, rho: int, gains: Gains, parameters: tuple[Parameter, ...], where: str
) -> None:
    """Check the file's numbers against the rules for values set for one run."""
    values = {item.name: item.value for item in parameters}
    keys = {name: f"joint.{name}" for name in values}
    keys |= {link.key: f"{link.table}.{link.key}" for link in LINKS if link.key in chain_numbers(spec)}
    keys |= {name: f"parameters.{name}.value" for name in spec.parameters}
    keys |= {FILTER_GAINS: "design.k"}
    keys |= {name: f"design.{name}" for name in (COMPENSATOR, INPUT_SCALE)}
    for kind in GAINS:
        names = kind.names(spec.order, rho) if gains.by_kind[kind.name] else ()
        values |= dict(zip(names, gains.by_kind[kind.name], strict=True))
        keys |= {name: f"design.{kind.name}, entry {i}" for i, name in enumerate(names, start=1)}
    if gains.observer is not None:
        values |= {OBSERVER: gains.observer}
        keys |= {OBSERVER: f"design.{OBSERVER}"}
    values |= {COMPENSATOR: float(gains.compensator), INPUT_SCALE: gains.input_scale}
    leading = spec.plant.b[0].strip() if spec.plant else ""
    scales = {item.name: item.scale for item in parameters}
    check_values(
        values,
        n=spec.order,
        rho=rho,
        limit=chain_names(spec).get(LIMIT),
        leading=leading if leading in spec.parameters else None,
        where=where,
        key=lambda name: keys[name],
        scales=scales,
    )
    rules = chain_rules(chain_names(spec), {})
    check_rules(values, rules, key=lambda name: f"{where}: {keys[name]}", scales=scales)
