"""From ``[adaptation]`` to the record of what the controller does not know, and what is refused there."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.adaptation import (
    INVERSE,
    LEAKAGE,
    LEAST_SQUARES,
    OF_TRACE,
    AdaptationSpec,
    InverseSpec,
    LeastSquaresSpec,
)
from pmjoint_codegen.modelfile.entries import slots_of
from pmjoint_codegen.modelfile.reserved import is_taken, own_names
from pmjoint_codegen.modelfile.schema import DesignSpec, ModelSpec
from pmjoint_codegen.modelfile.stated import SHARE, Stated, entry_of, stated_of
from pmjoint_codegen.values import BRAKING
from pmjoint_derive import Model
from pmjoint_derive.adaptation import Adaptation, Entry, Inverse, LeastSquares

ADAPTIVE: Final = "adaptive"  # row of `pmjoint_derive.derivation.DESIGNS`


def with_adaptation(model: Model, spec: ModelSpec, where: str) -> Model:
    """The model with what its controller does not know.

    Args:
        model: with numbers that have been checked.
        spec: the validated model file.
        where: file at the start of a message.

    Raises:
        ModelError: an unknown name, or numbers that no estimate can have.
    """
    table = spec.adaptation
    if table is None:
        return model
    if not (table.load or table.unknown or table.guess):
        raise ModelError(
            "neither unknown nor guess nor load is given",
            where=f"{where}: adaptation",
            remedy='give unknown = ["b0"], guess = { b0 = 1.0 } or load = true, or leave the table out',
        )
    stated = stated_of(table, slots_of(model), where)
    if not stated:
        return model  # a load that the controller knows
    adaptation = _adaptation(table, stated, model, where)
    if adaptation.unknown:
        _check_saturation(spec.design, table, where)
        model = replace(model, design=ADAPTIVE)
    model = replace(model, adaptation=adaptation)
    _check_names(model, spec, where)
    return model


def _adaptation(table: AdaptationSpec, stated: tuple[Stated, ...], model: Model, where: str) -> Adaptation:
    """The record, with numbers that follow."""
    _check_keys(table, model.plant.rho, where)
    squares = table.estimator == LEAST_SQUARES
    y = float(model.measures.y)
    found = tuple(entry_of(item, table, y, where) for item in stated)
    leading = next((entry for entry in found if entry.place == 0), None)
    known = leading is None or not leading.unknown
    if table.form == INVERSE and known:
        raise ModelError(
            'is "inverse", but b_m is known', where=f"{where}: adaptation.form", remedy='give form = "divide"'
        )
    unknown = sum(entry.unknown for entry in found)
    leakage = LEAKAGE if table.leakage is None else table.leakage
    return Adaptation(
        entries=found,
        leakage=leakage if unknown and not squares else 0.0,
        inverse=_inverse(table.inverse or InverseSpec(), leading, leakage, where)
        if table.form == INVERSE and leading is not None
        else None,
        least_squares=_squares(table.least_squares or LeastSquaresSpec(), unknown, where)
        if squares and unknown
        else None,
        force=table.force,
    )


def _check_keys(table: AdaptationSpec, rho: int, where: str) -> None:
    """Check which tables belong to which form and estimator."""
    place = f"{where}: adaptation"
    if table.inverse is not None and table.form != INVERSE:
        raise ModelError(
            'has no effect with form = "divide"', where=f"{place}.inverse", remedy='give form = "inverse"'
        )
    if table.estimator != LEAST_SQUARES:
        if table.least_squares is not None:
            raise ModelError(
                'has no effect with estimator = "tuning"',
                where=f"{place}.least_squares",
                remedy='give estimator = "least_squares"',
            )
        return
    if table.form == INVERSE:
        raise ModelError(
            'least squares estimates b_m, and form = "inverse" needs tuning functions',
            where=f"{place}.estimator",
            remedy='give form = "divide", or estimator = "tuning"',
        )
    if rho > 2:
        raise ModelError(
            f"least squares is proved up to relative degree 2, and this model has {rho}",
            where=f"{place}.estimator",
            remedy='give estimator = "tuning"',
        )
    for key in ("gain", "leakage", "prior"):
        if getattr(table, key) not in (None, {}):
            raise ModelError(
                "has no effect with least squares, whose gain is a state",
                where=f"{place}.{key}",
                remedy='leave it out, or give estimator = "tuning"',
            )


def _inverse(given: InverseSpec, leading: Entry, leakage: float, where: str) -> Inverse:
    """The estimate of 1/b_m."""
    place = f"{where}: adaptation.inverse"
    guess = 1 / leading.guess if given.guess is None else given.guess
    if guess * leading.guess < 0:
        raise ModelError(
            f"is {guess:g}, and the guess of b_m is {leading.guess:g}",
            where=f"{place}.guess",
            remedy="give both of one sign",
        )
    gain = given.gain
    if gain is None:
        if leading.range is None:
            raise ModelError(
                f"is missing, and so is a range of {leading.name}, from which it would follow",
                where=f"{place}.gain",
                remedy="give a gain",
            )
        low, high = leading.range
        gain = SHARE * ((1 / low - 1 / high) / 2) ** 2
    return Inverse(
        guess=guess,
        gain=gain,
        leakage=leakage if given.leakage is None else given.leakage,
        prior=guess if given.prior is None else given.prior,
    )


def _squares(given: LeastSquaresSpec, unknown: int, where: str) -> LeastSquares:
    """Least squares; its forgetting would turn round where the initial trace is above the bound."""
    trace = unknown * given.P0
    if given.k_max is not None and given.k_max < trace:
        raise ModelError(
            f"is {given.k_max:g}, less than the initial trace {trace:g} of the gain matrix",
            where=f"{where}: adaptation.least_squares.k_max",
            remedy=f"allowed: a number of {trace:g} or greater",
        )
    k_max = OF_TRACE * trace if given.k_max is None else given.k_max
    return LeastSquares(kappa=given.kappa, forgetting=given.forgetting, P0=given.P0, k_max=k_max)


def _check_saturation(design: DesignSpec, table: AdaptationSpec, where: str) -> None:
    """Estimates need the compensator: under clipping they learn from errors that the limit makes."""
    if design.saturation == BRAKING:
        raise ModelError(
            "braking is not proved for a design with estimates",
            where=f"{where}: design.saturation",
            remedy='give saturation = "compensator"',
        )
    if not design.compensated and not table.force:
        key = "saturation" if design.compensator is None else "compensator"
        raise ModelError(
            "plain clipping misleads the estimates, which can destroy the loop",
            where=f"{where}: design.{key}",
            remedy='give saturation = "compensator", or force = true in [adaptation]',
        )


def _check_names(model: Model, spec: ModelSpec, where: str) -> None:
    """No parameter or state may have the name of a guess, an estimate or another number of the controller."""
    adaptation = model.adaptation
    assert adaptation is not None
    names = own_names(adaptation)
    for name in names:
        if names.count(name) > 1:
            entry = next(entry for entry in adaptation.entries if name in _of_entry(entry))
            raise ModelError(
                f"{name} of the entry {entry.name} already names a number of the controller",
                where=f"{where}: parameters.{entry.name}",
                remedy="choose another name",
            )
    states = (spec.system.states or ()) if spec.system is not None else ()
    keys = {name: f"system.states, entry {i}" for i, name in enumerate(states, start=1)}
    keys |= {item.name: f"parameters.{item.name}" for item in model.parameters}
    for name, key in keys.items():
        if is_taken(name, adaptation):
            raise ModelError(
                "already names an estimate, a number or a step of the controller",
                where=f"{where}: {key}",
                remedy="choose another name",
            )


def _of_entry(entry: Entry) -> tuple[str, ...]:
    symbols = (entry.guess_symbol, *entry.ends, entry.prior_symbol, entry.gamma, entry.estimate)
    return tuple(symbol.name for symbol in symbols)
