"""The keys of a model file (schema 1), each with its type; a field's description states what is allowed.

Lengths that span tables (n, m, p, rho) are checked after the single keys; what needs mathematics, in `model`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sized
from typing import Any, Literal

from pydantic import Field, ValidationError

from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.modelfile.adaptation import AdaptationSpec
from pmjoint_codegen.modelfile.bench import ActuatorSpec, SensorSpec, Setting, chain_numbers, check_bench
from pmjoint_codegen.modelfile.complaints import first_complaint
from pmjoint_codegen.modelfile.joint import JointSpec, check_kept, joint_names
from pmjoint_codegen.modelfile.law import LawSpec, check_law
from pmjoint_codegen.modelfile.load import load_lines
from pmjoint_codegen.modelfile.muscle import check_muscles, law_lines, own_names
from pmjoint_codegen.modelfile.names import MODEL_NAME, key_path, why_not
from pmjoint_codegen.modelfile.start import in_order, named_start
from pmjoint_codegen.modelfile.system import SystemSpec, check_system, refuse_beyond
from pmjoint_codegen.modelfile.tables import (
    LARGEST_ORDER,
    Expression,
    Expressions,
    InputScale,
    Line,
    Numbers,
    ParameterSpec,
    Poles,
    PolesEntry,
    Positive,
    Range,
    Table,
    Unit,
)
from pmjoint_codegen.reference.command import DATA
from pmjoint_codegen.values import BRAKING, CLIP, GAINS
from pmjoint_derive.joint import TAKEN

PHYSICS = ("plant", "joint", "system")  # tables that describe a plant: a file has one


class PlantSpec(Table):
    """``[plant]``: (11) in general order; expressions are still text."""

    order: int = Field(ge=1, le=LARGEST_ORDER, description=f"a whole number from 1 to {LARGEST_ORDER}")
    phi: Expressions | None = Field(
        default=None, description="a list of order expressions of y and parameters"
    )
    Phi: tuple[Expressions, ...] | None = Field(
        default=None, description="a list of order rows, each a list of expressions as long as theta"
    )
    theta: Expressions = Field(
        default=(),
        max_length=LARGEST_ORDER,
        description=f"a list of at most {LARGEST_ORDER} expressions of parameters",
    )
    b: Expressions = Field(description='a list of expressions of parameters, b_m ... b_0, such as ["b0"]')
    sigma: Expression = Field(default="1", description="an expression of y and parameters")
    disturbance: Expressions | None = Field(
        default=None, description="a list of order expressions of x1.., t and parameters"
    )
    disturbance_bound: float | None = Field(
        default=None, ge=0, allow_inf_nan=False, description="a finite number, 0 or greater"
    )
    range: Range | None = Field(
        default=None, description="a list of two finite numbers, least and greatest y of the design"
    )


class DesignSpec(LawSpec):
    """``[design]``: gains, checked by `pmjoint_codegen.values`; `gains_of` has those left out."""

    c: Numbers | None = Field(default=None, description="a list of finite numbers greater than 0")
    e: Numbers | None = Field(default=None, description="a list of finite numbers greater than 0")
    ck: Numbers | None = Field(default=None, description="a list of finite numbers greater than 0")
    k: Numbers | None = Field(default=None, description="a list of finite numbers")
    compensator: bool | None = Field(default=None, description="true or false")
    input_scale: InputScale = Field(default=1.0, description='a finite number greater than 0, or "auto"')
    poles: PolesEntry = Field(
        default=None,
        description="a number p > 0 for poles at -p, or a list of such and of pairs [re, im], a pole a state",
    )
    bandwidth: Positive | None = Field(default=None, description="a finite number of 1/s greater than 0")
    saturation: Literal["compensator", "clip", "braking"] | None = Field(
        default=None, description='"compensator", "clip" or "braking"'
    )
    braking: float | None = Field(
        default=None, gt=0, allow_inf_nan=False, description="a finite number greater than 0"
    )
    start: Literal["zero", "matched"] = Field(default="zero", description='"zero" or "matched"')

    @property
    def compensated(self) -> bool:
        """Whether (23) is driven."""
        return self.saturation != CLIP if self.compensator is None else self.compensator


class SimulationSpec(Table):
    """``[simulation]``."""

    reference: Expression = Field(
        description="an expression of t and parameters, or data such as { steps = [[0, 0], [1, 0.5]] }"
    )
    x0: Numbers = Field(description="a list of finite numbers, one for each state, or a table by name")
    horizon: Positive = Field(description="a finite number of seconds greater than 0")
    output_step: Positive = Field(default=0.01, description="a finite number of seconds greater than 0")
    sample_time: Positive = Field(default=0.001, description="a finite number of seconds greater than 0")
    delay_samples: Setting | None = Field(default=None, description="the name of a parameter, or a number")
    jitter: Setting | None = Field(default=None, description="the name of a parameter, or a number")


class UnitsSpec(Table):
    """``[units]``: of the measured output and of the input."""

    y: Unit = Field(default="rad", description='text such as "rad", 60 characters at most')
    u: Unit = Field(default="V", description='text such as "V", 60 characters at most')


class ModelSpec(Table):
    """A whole model file."""

    schema_: int = Field(alias="schema", ge=1, le=1, description="1, the only schema there is")
    name: str = Field(
        pattern=MODEL_NAME,
        description="letters, digits, - and _, beginning with a letter or digit, 64 at most",
    )
    title: Line = Field(default="", description="one line of text, 400 characters at most")
    source: Line = Field(default="", description="one line of text, 400 characters at most")
    parameters: dict[str, ParameterSpec] = Field(
        description='lines such as b0 = { value = 2.0, unit = "rad/(s^2 V)" }'
    )
    plant: PlantSpec | None = Field(default=None, description="the table [plant]")
    joint: JointSpec | None = Field(default=None, description="the table [joint], in place of [plant]")
    system: SystemSpec | None = Field(default=None, description="the table [system], in place of [plant]")
    actuator: ActuatorSpec = Field(description='the table [actuator] with limit = "..."')
    sensor: SensorSpec = Field(default=SensorSpec(), description="the table [sensor]")
    design: DesignSpec = Field(description="the table [design] with c, e, ck and k")
    simulation: SimulationSpec = Field(description="the table [simulation] with reference, x0 and horizon")
    units: UnitsSpec = Field(default=UnitsSpec(), description="the table [units] with y and u")
    adaptation: AdaptationSpec | None = Field(default=None, description="the table [adaptation]")

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the model's parameters, in its order."""
        joint = joint_names(self.joint) if self.joint else ()
        own = own_names(self.joint) if self.joint else ()
        return (*joint, *self.lines, *own)

    @property
    def lines(self) -> dict[str, ParameterSpec]:
        """Lines of ``[parameters]``, those of a law of force and of a load, and numbers of the bench."""
        of_law = law_lines(self.joint, self.parameters) if self.joint else {}
        return {**self.parameters, **of_law, **chain_numbers(self), **load_lines(self)}

    @property
    def y_range(self) -> tuple[float, float] | None:
        """Least and greatest y of the design, where the file states them."""
        return self.physics.range

    @property
    def physics(self) -> PlantSpec | JointSpec | SystemSpec:
        """The one of the three tables of the plant that the file has."""
        table = self.plant or self.joint or self.system
        assert table is not None  # `validate` demands one
        return table

    @property
    def physics_table(self) -> str:
        """Its name."""
        return next(name for name in PHYSICS if getattr(self, name) is not None)

    @property
    def order(self) -> int:
        """Order n of the design's plant."""
        return self.physics.order

    @property
    def relative_degree(self) -> int | None:
        """Relative degree rho of the design's plant; None where only the derivation knows it."""
        if self.system is not None:
            transfer = self.system.transfer_function
            return self.order + 1 - len(transfer.num) if transfer else None
        return self.order + 1 - (len(self.plant.b) if self.plant else 1)


def validate(document: Mapping[str, Any], where: str) -> ModelSpec:
    """Check a document against the schema.

    Args:
        document: a model file as nested dictionaries.
        where: file at the start of a message.

    Raises:
        ModelError: one line naming file, key, what is wrong and what is allowed there.
    """
    refuse_beyond(document, where)
    named = named_start(document)
    try:
        spec = ModelSpec.model_validate(_tuples(_without_tables(document)))
    except ValidationError as error:
        raise first_complaint(error, ModelSpec, where) from None
    _check_physics(spec, where)
    _check_names(spec, where)
    if spec.joint is not None:
        check_kept(spec.joint, where)
    if spec.plant is not None:
        _check_plant(spec.plant, where)
    if spec.system is not None:
        check_system(spec.system, {**spec.parameters, **chain_numbers(spec)}, where)
    if spec.y_range is not None and not spec.y_range[0] < spec.y_range[1]:
        raise ModelError(
            f"is {list(spec.y_range)}",
            where=f"{where}: {spec.physics_table}.range",
            remedy="allowed: [least y, greatest y]",
        )
    if check_law(spec, where):
        _check_design(spec.design, where)
    if named is not None:
        simulation = spec.simulation.model_copy(update={"x0": in_order(spec, named, where)})
        spec = spec.model_copy(update={"simulation": simulation})
    _check_lengths(spec, where)
    if spec.relative_degree is not None:
        check_degree(spec, spec.relative_degree, where)
    return spec


def _check_physics(spec: ModelSpec, where: str) -> None:
    """Check that a file describes its plant once."""
    given = [name for name in PHYSICS if getattr(spec, name) is not None]
    if len(given) != 1:
        found = f"{' and '.join(given)} are given" if given else "is missing, and so are [joint] and [system]"
        raise ModelError(
            "both are given" if given == ["plant", "joint"] else found,
            where=f"{where}: plant",
            remedy="allowed: one of [plant], [joint] and [system]",
        )


def check_degree(spec: ModelSpec, rho: int, where: str) -> None:
    """Compare the gains of steps with the relative degree, and braking with what is derived.

    Args:
        spec: a file; where its table is [system], `validate` does not know rho.
        rho: relative degree.
        where: file at the start of a message.

    Raises:
        ModelError: naming the key.
    """
    degree = {
        "plant": "relative degree = order + 1 - length of b",
        "joint": "relative degree of the joint",
        "system": "relative degree of the system",
    }
    for kind in GAINS:
        entries = getattr(spec.design, kind.name)
        if not kind.of_filters and entries is not None and len(entries) != rho:
            reason = degree[spec.physics_table]
            raise _wrong_length(where, f"design.{kind.name}", len(entries), f"{rho} ({reason})")
    _check_saturation(spec.design, rho, where)


def _check_saturation(design: DesignSpec, rho: int, where: str) -> None:
    """Two spellings that agree, and braking where it is derived."""
    place = f"{where}: design.saturation"
    both = design.compensator is not None and design.saturation is not None
    if both and design.compensator != (design.saturation != CLIP):
        raise ModelError(
            f"is {quoted(str(design.saturation))}, but compensator is {str(design.compensator).lower()}",
            where=place,
            remedy="give saturation alone",
        )
    if design.saturation == BRAKING and rho > 2:
        raise ModelError(
            f"braking is derived for relative degree 2 only, and this model has {rho}: beyond, no braking "
            "curve is proved",
            where=place,
            remedy="allowed: compensator, clip",
        )
    if design.braking is not None and design.saturation != BRAKING:
        raise ModelError(
            "has no effect on this saturation",
            where=f"{where}: design.braking",
            remedy='give saturation = "braking"',
        )


def _without_tables(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """The document with `DATA` for a reference that is a table: whoever has the file's folder reads that.

    A start that is a table is an empty list: its names can be checked once the rest is.
    """
    simulation = document.get("simulation")
    if not isinstance(simulation, Mapping):
        return document
    marks = {"reference": DATA, "x0": []}
    found = {key: mark for key, mark in marks.items() if isinstance(simulation.get(key), Mapping)}
    return {**document, "simulation": {**simulation, **found}}


def _tuples(value: Any) -> Any:
    """Turn lists into tuples, which are what strict and frozen tables hold."""
    if isinstance(value, Mapping):
        return {key: _tuples(inner) for key, inner in value.items()}
    return tuple(_tuples(inner) for inner in value) if isinstance(value, list) else value


def _check_names(spec: ModelSpec, where: str) -> None:
    for name in spec.parameters:
        reason = why_not(name)
        if spec.joint is not None and name in joint_names(spec.joint):
            reason = "is already in [joint]"
        elif spec.joint is not None and name in TAKEN:
            reason = "already names a coefficient, pressure or state of the joint"
        if reason:
            raise ModelError(
                reason, where=f"{where}: {key_path(('parameters', name))}", remedy="choose another name"
            )
    joint = joint_names(spec.joint) if spec.joint is not None else ()
    if spec.joint is not None:
        check_muscles(spec.joint, spec.parameters, where)
        joint = (*joint, *own_names(spec.joint), *law_lines(spec.joint, spec.parameters))
    check_bench(spec, tuple(dict.fromkeys((*joint, *spec.parameters))), where)


def _check_plant(plant: PlantSpec, where: str) -> None:
    """Compare the lists of ``[plant]`` with its order n and the length p of theta."""
    n, p = plant.order, len(plant.theta)
    if not 1 <= len(plant.b) <= n:
        raise _wrong_length(where, "plant.b", len(plant.b), f"1 to {n} (b_m ... b_0, order = {n})")
    if (plant.Phi is None) != (p == 0) and plant.Phi != ((),) * n:
        raise ModelError(
            "Phi and theta belong together", where=f"{where}: plant", remedy="give both, or neither"
        )
    lists: dict[str, Sized | None] = {"phi": plant.phi, "Phi": plant.Phi, "disturbance": plant.disturbance}
    for key, entries in lists.items():
        if entries is not None and len(entries) != n:
            raise _wrong_length(where, f"plant.{key}", len(entries), f"{n} (order of the plant)")
    for i, row in enumerate(plant.Phi or (), start=1):
        if len(row) != p:
            raise _wrong_length(where, f"plant.Phi, entry {i}", len(row), f"{p} (as long as theta)")


def _check_design(design: DesignSpec, where: str) -> None:
    """Check that each list of gains is given once, or follows from another key."""
    if design.k is not None and design.poles is not None:
        raise ModelError(
            "k and poles are both given", where=f"{where}: design.poles", remedy="give one of them"
        )
    if design.bandwidth is not None:
        return
    for kind in GAINS:
        follows = kind.of_filters and design.poles is not None
        if getattr(design, kind.name) is None and not follows:
            instead = "poles or bandwidth" if kind.of_filters else "bandwidth"
            allowed = DesignSpec.model_fields[kind.name].description
            raise ModelError(
                "is missing",
                where=f"{where}: design.{kind.name}",
                remedy=f"allowed: {allowed}; or give {instead}",
            )


def _check_poles(poles: Poles, n: int, where: str) -> None:
    """Compare the number of poles with the order; a pair is two."""
    if isinstance(poles, tuple):
        count = sum(2 if isinstance(entry, tuple) else 1 for entry in poles)
        if count != n:
            raise _wrong_length(where, "design.poles", count, f"{n} (order of the plant; a pair is two)")


def _check_lengths(spec: ModelSpec, where: str) -> None:
    """Compare filter gains and initial state with the order n."""
    n = spec.order
    _check_poles(spec.design.poles, n, where)
    of_order = {"design.k": spec.design.k, "simulation.x0": spec.simulation.x0}
    if spec.joint is not None:
        del of_order["simulation.x0"]
        _check_start(spec.joint, spec.simulation.x0, where)
    for key, entries in of_order.items():
        if entries is not None and len(entries) != n:
            raise _wrong_length(where, key, len(entries), f"{n} (order of the plant)")


def _check_start(joint: JointSpec, x0: Sized, where: str) -> None:
    """A joint starts in its own states: angle and rate and, where pressures lag, their distances from P_0."""
    lagged = joint.tau is not None
    if len(x0) != 2 and not (lagged and len(x0) == 4):
        rule = "2 (theta, theta_dot), or 4 with q1 and q2" if lagged else "2 (theta, theta_dot)"
        raise _wrong_length(where, "simulation.x0", len(x0), rule)


def _wrong_length(where: str, key: str, found: int, allowed: str) -> ModelError:
    entries = "entry" if found == 1 else "entries"
    return ModelError(f"has {found} {entries}", where=f"{where}: {key}", remedy=f"allowed: {allowed}")
