"""The keys of a model file (schema 1), each with its type; a field's description says what is allowed there.

Lengths that span tables (n, m, p, rho) are checked after the single keys; what needs mathematics, in `model`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sized
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.spec.complaints import first_complaint
from pmjoint_codegen.spec.names import key_path, why_not

LARGEST_ORDER = 9  # beyond it, names such as Xi111 would be ambiguous


def _as_text(value: object) -> object:
    """Take a bare number for an expression: ``sigma = 1``."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _printable(text: str) -> str:
    """Refuse line ends and control characters: these texts go into comments, tables and terminals."""
    if not text.isprintable():
        raise ValueError
    return text


Expression = Annotated[str, BeforeValidator(_as_text)]
Expressions = tuple[Expression, ...]
Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Numbers = tuple[Number, ...]
Line = Annotated[str, Field(max_length=400), AfterValidator(_printable)]
Unit = Annotated[str, Field(max_length=60), AfterValidator(_printable)]


class Table(BaseModel):
    """A table of a model file: no unknown keys, no silent conversions, no change once it is read."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class ParameterSpec(Table):
    """One line of ``[parameters]``."""

    value: Number = Field(description="a finite number")
    unit: Unit = Field(default="1", description='text such as "rad/s", 60 characters at most')
    about: Line = Field(default="", description="one line of text, 400 characters at most")


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


class ActuatorSpec(Table):
    """``[actuator]``."""

    limit: str = Field(description="the name of a parameter")


class DesignSpec(Table):
    """``[design]``: gains, checked by `pmjoint_codegen.values`."""

    c: Numbers = Field(description="a list of finite numbers greater than 0")
    e: Numbers = Field(description="a list of finite numbers greater than 0")
    ck: Numbers = Field(description="a list of finite numbers greater than 0")
    k: Numbers = Field(description="a list of finite numbers")
    compensator: bool = Field(default=True, description="true or false")


class SimulationSpec(Table):
    """``[simulation]``."""

    reference: Expression = Field(description="an expression of t and parameters")
    x0: Numbers = Field(description="a list of finite numbers, one for each state")
    horizon: Positive = Field(description="a finite number of seconds greater than 0")
    output_step: Positive = Field(default=0.01, description="a finite number of seconds greater than 0")
    sample_time: Positive = Field(default=0.001, description="a finite number of seconds greater than 0")


class UnitsSpec(Table):
    """``[units]``: of the measured output and of the input."""

    y: Unit = Field(default="rad", description='text such as "rad", 60 characters at most')
    u: Unit = Field(default="V", description='text such as "V", 60 characters at most')


class ModelSpec(Table):
    """A whole model file."""

    schema_: int = Field(alias="schema", ge=1, le=1, description="1, the only schema there is")
    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$",
        description="letters, digits, - and _, beginning with a letter or digit, 64 at most",
    )
    title: Line = Field(default="", description="one line of text, 400 characters at most")
    source: Line = Field(default="", description="one line of text, 400 characters at most")
    parameters: dict[str, ParameterSpec] = Field(
        description='lines such as b0 = { value = 2.0, unit = "rad/(s^2 V)" }'
    )
    plant: PlantSpec = Field(description="the table [plant]")
    actuator: ActuatorSpec = Field(description='the table [actuator] with limit = "..."')
    design: DesignSpec = Field(description="the table [design] with c, e, ck and k")
    simulation: SimulationSpec = Field(description="the table [simulation] with reference, x0 and horizon")
    units: UnitsSpec = Field(default=UnitsSpec(), description="the table [units] with y and u")


def validate(document: Mapping[str, Any], where: str) -> ModelSpec:
    """Check a document against the schema.

    Args:
        document: a model file as nested dictionaries.
        where: file that a message begins with.

    Raises:
        ModelError: one line naming file, key, what is wrong and what is allowed there.
    """
    try:
        spec = ModelSpec.model_validate(_tuples(document))
    except ValidationError as error:
        raise first_complaint(error, ModelSpec, where) from None
    _check_names(spec, where)
    _check_lengths(spec, where)
    return spec


def _tuples(value: Any) -> Any:
    """Turn lists into tuples, which are what strict and frozen tables hold."""
    if isinstance(value, Mapping):
        return {key: _tuples(inner) for key, inner in value.items()}
    return tuple(_tuples(inner) for inner in value) if isinstance(value, list) else value


def _check_names(spec: ModelSpec, where: str) -> None:
    for name in spec.parameters:
        if reason := why_not(name):
            raise ModelError(
                reason, where=f"{where}: {key_path(('parameters', name))}", remedy="choose another name"
            )
    if spec.actuator.limit not in spec.parameters:
        raise ModelError(
            f"no parameter is called {quoted(spec.actuator.limit)}",
            where=f"{where}: actuator.limit",
            remedy=f"allowed: {', '.join(spec.parameters)}"
            if spec.parameters
            else "declare it in [parameters]",
        )


def _check_lengths(spec: ModelSpec, where: str) -> None:
    """Compare every list with the order n, the relative degree rho and the length p of theta."""
    plant, n, p = spec.plant, spec.plant.order, len(spec.plant.theta)
    if not 1 <= len(plant.b) <= n:
        raise _wrong_length(where, "plant.b", len(plant.b), f"1 to {n} (b_m ... b_0, order = {n})")
    if (plant.Phi is None) != (p == 0) and plant.Phi != ((),) * n:
        raise ModelError(
            "Phi and theta belong together", where=f"{where}: plant", remedy="give both, or neither"
        )
    rho = n + 1 - len(plant.b)
    for key, found, wanted, why in (*_of_order(spec, n), *_of_relative_degree(spec, rho)):
        if found != wanted:
            raise _wrong_length(where, key, found, f"{wanted} ({why})")
    for i, row in enumerate(plant.Phi or (), start=1):
        if len(row) != p:
            raise _wrong_length(where, f"plant.Phi, entry {i}", len(row), f"{p} (as long as theta)")


def _of_order(spec: ModelSpec, n: int) -> Iterable[tuple[str, int, int, str]]:
    plant = spec.plant
    lists: dict[str, Sized | None] = {
        "plant.phi": plant.phi,
        "plant.Phi": plant.Phi,
        "plant.disturbance": plant.disturbance,
        "design.k": spec.design.k,
        "simulation.x0": spec.simulation.x0,
    }
    return [
        (key, len(entries), n, "order of the plant") for key, entries in lists.items() if entries is not None
    ]


def _of_relative_degree(spec: ModelSpec, rho: int) -> Iterable[tuple[str, int, int, str]]:
    lists = {"design.c": spec.design.c, "design.e": spec.design.e, "design.ck": spec.design.ck}
    return [
        (key, len(gains), rho, "relative degree = order + 1 - length of b") for key, gains in lists.items()
    ]


def _wrong_length(where: str, key: str, found: int, allowed: str) -> ModelError:
    entries = "entry" if found == 1 else "entries"
    return ModelError(f"has {found} {entries}", where=f"{where}: {key}", remedy=f"allowed: {allowed}")
