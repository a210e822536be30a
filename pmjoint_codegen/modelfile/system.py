"""``[system]``: a plant by the rates of its own states, or by a transfer function.

Its parameters have units, as those of ``[joint]`` do. Rates, output and disturbance are expressions in SI
units, and so is what this module gives; `pmjoint_codegen.modelfile.columns` has the units of states, y and
u. The mathematics is `pmjoint_derive.system`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import sympy as sp
from pydantic import Field

from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.modelfile.expressions import parse
from pmjoint_codegen.modelfile.names import why_not
from pmjoint_codegen.modelfile.tables import LARGEST_ORDER, Expression, Expressions, Range, Table, Unit
from pmjoint_derive import Parameter, Plant, real_symbol
from pmjoint_derive.physics import U
from pmjoint_derive.system import System, reduce_system, transfer_plant

OF_ERROR, OF_RATE = "e", "theta_dot"  # columns that no expression of a model file names


class TransferSpec(Table):
    """``transfer_function``: coefficients of numerator and denominator, highest power first."""

    num: Expressions = Field(
        min_length=1, description="a list of expressions of parameters, highest power first"
    )
    den: Expressions = Field(
        min_length=2,
        max_length=LARGEST_ORDER + 1,
        description=f"a list of 2 to {LARGEST_ORDER + 1} expressions of parameters, highest power first",
    )


class SystemSpec(Table):
    """``[system]``: states, rates, input and output; or a transfer function. Expressions are still text."""

    states: tuple[str, ...] | None = Field(
        default=None,
        min_length=1,
        max_length=LARGEST_ORDER,
        description=f'a list of at most {LARGEST_ORDER} names, such as ["theta", "omega"]',
    )
    rates: Expressions | None = Field(
        default=None, description="a list with an expression of states, input and parameters for each state"
    )
    input: str = Field(default="u", description='the name of the input in rates, such as "u"')
    output: Expression | None = Field(
        default=None, description="the measured state, or an expression of states and parameters"
    )
    units: tuple[Unit, ...] | None = Field(default=None, description="a list with the unit of each state")
    transfer_function: TransferSpec | None = Field(
        default=None, description="{ num = [...], den = [...] }, in place of states, rates and output"
    )
    disturbance: Expressions | None = Field(
        default=None, description="a list with an expression of states, t and parameters for each state"
    )
    disturbance_bound: float | None = Field(
        default=None, ge=0, allow_inf_nan=False, description="a finite number, 0 or greater"
    )
    range: Range | None = Field(
        default=None, description="a list of two finite numbers, least and greatest y of the design"
    )

    @property
    def order(self) -> int:
        """Order n of the plant."""
        if self.transfer_function is not None:
            return len(self.transfer_function.den) - 1
        return len(self.states or ())


def refuse_beyond(document: Mapping[str, Any], where: str) -> None:
    """Refuse what people write for plants beyond the class, before the schema calls it a wrong type.

    Raises:
        ModelError: more than one input or output, or a dead time.
    """
    system = document.get("system")
    if not isinstance(system, Mapping):
        return
    transfer = system.get("transfer_function")
    entries = {"input": system.get("input"), "output": system.get("output")}
    if isinstance(transfer, Mapping):
        nested = [
            name
            for name in ("num", "den")
            if isinstance(transfer.get(name), list) and any(isinstance(one, list) for one in transfer[name])
        ]
        entries |= {f"transfer_function.{name}": [] for name in nested}
        late = [name for name in transfer if name in ("delay", "dead_time", "tau_d", "input_delay")]
        if late:
            raise _dead_time(f"{where}: system.transfer_function.{late[0]}")
    for name, value in entries.items():
        if isinstance(value, list):
            raise ModelError(
                "is a list, and the design is for one input and one output",
                where=f"{where}: system.{name}",
                remedy="give one; design one loop at a time, with the others' coupling as disturbance",
            )
    named = system.get("input", "u")
    rates = system.get("rates")
    for i, rate in enumerate(rates if isinstance(rates, list) else [], start=1):
        if isinstance(rate, str) and re.search(rf"\b{re.escape(str(named))}\s*\(\s*t\b", rate):
            raise _dead_time(f"{where}: system.rates, entry {i}")


def _dead_time(place: str) -> ModelError:
    return ModelError(
        "a dead time is not part of the design",
        where=place,
        remedy="actuator.delay simulates one; design without it, with gains slow against it",
    )


def check_system(system: SystemSpec, parameters: Mapping[str, object], where: str) -> None:
    """Check which keys are given, their lengths, and the names of the states.

    Raises:
        ModelError: for the first key at fault.
    """
    place = f"{where}: system"
    given = {name: getattr(system, name) for name in ("states", "rates", "output")}
    if system.transfer_function is not None:
        extra = next((name for name in (*given, "units") if getattr(system, name) is not None), None)
        if extra:
            raise ModelError(
                "stands beside a transfer function, which has its own",
                where=f"{place}.{extra}",
                remedy="give transfer_function alone, or states, rates and output",
            )
    else:
        missing = next((name for name, value in given.items() if value is None), None)
        if missing:
            raise ModelError(
                "is missing",
                where=f"{place}.{missing}",
                remedy="allowed: states, rates and output together, or transfer_function",
            )
    n = system.order
    for key in ("rates", "units", "disturbance"):
        entries = getattr(system, key)
        if entries is not None and len(entries) != n:
            number = f"{len(entries)} {'entry' if len(entries) == 1 else 'entries'}"
            raise ModelError(f"has {number}", where=f"{place}.{key}", remedy=f"allowed: {n}, one a state")
    _check_names(system, parameters, place)


def _check_names(system: SystemSpec, parameters: Mapping[str, object], place: str) -> None:
    states = system.states or ()
    for i, name in enumerate(states, start=1):
        reason = why_not(name)
        if name in parameters:
            reason = "is a parameter too"
        elif name in states[: i - 1]:
            reason = "is there twice"
        elif name == OF_ERROR:
            reason = "already names a column, the tracking error"
        elif name == OF_RATE and system.output not in [
            state for state, rate in zip(states, system.rates or (), strict=False) if rate.strip() == OF_RATE
        ]:
            reason = "names the rate of the output"
        elif name == system.input:
            reason = "is the input too"
        if reason:
            raise ModelError(
                f"{quoted(name)} {reason}",
                where=f"{place}.states, entry {i}",
                remedy="choose another name for the state",
            )
    clash = system.input in parameters
    if clash or (system.input != "u" and why_not(system.input)):
        reason = "is a parameter too" if clash else why_not(system.input)
        raise ModelError(
            f"{quoted(system.input)} {reason}",
            where=f"{place}.input",
            remedy='choose another name, such as "u"',
        )


def to_system(spec: SystemSpec, parameters: tuple[Parameter, ...], y_unit: str, where: str) -> dict[str, Any]:
    """The fields of `Model` that a system fills.

    Args:
        spec: the table.
        parameters: all parameters of the model.
        y_unit: unit of the output.
        where: file at the start of a message.

    Raises:
        ModelError: for a bad expression.
        OutsideClassError: there is no output-feedback form.
    """
    known = {item.name: item.symbol for item in parameters}
    if spec.transfer_function is not None:
        return {"plant": _transfer(spec, spec.transfer_function, known, where)}
    assert spec.rates is not None and spec.output is not None and spec.states is not None
    states = {name: real_symbol(name) for name in spec.states}
    signals = {**states, spec.input: U}

    def column(key: str, texts: tuple[str, ...], symbols: Mapping[str, sp.Symbol]) -> tuple[sp.Expr, ...]:
        return tuple(
            parse(
                text,
                symbols,
                f"{where}: system.{key}, entry {i}",
                kinks=key == "disturbance",
                signals=tuple(signals),
            )
            for i, text in enumerate(texts, start=1)
        )

    found: System = reduce_system(
        tuple(states.values()),
        column("rates", spec.rates, {**signals, **known}),
        parse(spec.output, {**signals, **known}, f"{where}: system.output", signals=tuple(signals)),
        column(
            "disturbance",
            spec.disturbance or ("0",) * spec.order,
            {**states, "t": real_symbol("t"), **known},
        ),
        spec.units or (None,) * spec.order,
        y_unit,
    )
    return vars(found)


def _transfer(spec: SystemSpec, transfer: TransferSpec, known: Mapping[str, sp.Symbol], where: str) -> Plant:
    place = f"{where}: system"
    of_state = {f"x{i}": real_symbol(f"x{i}") for i in range(1, spec.order + 1)} | {"t": real_symbol("t")}

    def coefficients(key: str, texts: tuple[str, ...]) -> tuple[sp.Expr, ...]:
        return tuple(
            parse(text, known, f"{place}.transfer_function.{key}, entry {i}")
            for i, text in enumerate(texts, start=1)
        )

    return transfer_plant(
        coefficients("num", transfer.num),
        coefficients("den", transfer.den),
        tuple(
            parse(text, {**of_state, **known}, f"{place}.disturbance, entry {i}", kinks=True)
            for i, text in enumerate(spec.disturbance or ("0",) * spec.order, start=1)
        ),
    )
