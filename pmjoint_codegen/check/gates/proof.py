"""Proof: the certificate of the model: identities that expand to zero, and definite matrices."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmjoint_codegen.check.oracles.certificate import certify, numeric
from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.poles import poles_text
from pmjoint_codegen.values import INPUT_SCALE, OBSERVER, positive_gains
from pmjoint_derive import Derivation
from pmjoint_derive.adaptation import settings_of
from pmjoint_derive.consistency import consistency_identities
from pmjoint_derive.equation import Identity
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.lyapunov import given_away
from pmjoint_derive.lyapunov_matrix import lyapunov_matrix
from pmjoint_derive.units import parse_unit

LONGEST = 300  # characters of a remainder that a report shows


def check(subject: Subject) -> GateResult:
    """Prove the certificate with symbolic gains, then evaluate it for the model's own."""
    return prove_for(subject.derivation, design_values(subject.derivation))


def design_values(derivation: Derivation) -> dict[str, float]:
    """Every parameter and gain of the model by name, guesses included."""
    model = derivation.model
    values = {item.name: item.value for item in model.parameters}
    values |= {
        item.symbol.name: item.value for item in settings_of(model.adaptation, parse_unit(model.y_unit))
    }
    return values | {symbol.name: float(value) for symbol, value in derivation.gain_values.items()}


def prove_for(derivation: Derivation, values: Mapping[str, float]) -> GateResult:
    """All statements of the certificate for one design.

    Args:
        derivation: the design.
        values: parameters and gains.
    """
    identities = (*derivation.design.prove(derivation), *consistency_identities(derivation))
    broken = [item for item in identities if not item.holds]
    if broken:
        names = ", ".join(item.name for item in broken)
        detail = f"{len(broken)} of {len(identities)} identities do not expand to zero: {names}"
        return failed(detail, len(broken), 0, _difference(broken[0]))
    faults = unfit_gains(derivation, values)
    if not derivation.design.certifies and not faults:
        detail = f"identities that do not expand to zero, of {len(identities)}; the law has no certificate"
        return passed(detail, 0, 0)
    if not derivation.design.decays:
        return _not_rising(derivation, values, faults, len(identities))
    certificate = certify(derivation, values, derivation.model.disturbance_bound) if not faults else None
    if certificate is None or not np.all(np.linalg.eigvalsh(certificate.P) > 0):
        faults = faults or ["P is not positive definite"]
    elif beyond := certificate.unbounded():
        faults = [f"not a finite number at these gains: {', '.join(beyond)}"]
    if certificate is None or faults:
        return failed(
            "; ".join(faults), len(faults), 0, Difference("certificate", faults[0], "", "", "", "", "")
        )
    detail = f"identities that do not expand to zero, of {len(identities)}; {certificate.lines()[1]}"
    return passed(detail, 0, 0, *certificate.lines(), remainder_text(derivation))


def _not_rising(
    derivation: Derivation, values: Mapping[str, float], faults: list[str], count: int
) -> GateResult:
    """The verdict on a V that does not rise: it is positive definite where P is."""
    P = numeric(lyapunov_matrix(derivation.signals), values)
    if not faults and not np.all(np.linalg.eigvalsh(P) > 0):
        faults = ["P is not positive definite"]
    if faults:
        return failed("; ".join(faults), len(faults), 0, Difference("V", faults[0], "", "", "", "", ""))
    claim = no_certificate(derivation) or "V does not rise where D and leakage are 0"
    detail = f"identities that do not expand to zero, of {count}; {claim}"
    return passed(detail, 0, 0, f"P = {[[float(f'{entry:.5g}') for entry in row] for row in P]}")


def no_certificate(derivation: Derivation) -> str:
    """Why nothing is claimed of V of a design with estimates, or nothing."""
    adaptation = derivation.design.adaptation
    if adaptation is None or not adaptation.unknown:
        return ""
    if adaptation.least_squares is not None:
        return "no V covers least squares together with the law"
    still = [entry.name for entry in adaptation.unknown if not entry.gain > 0]
    still += ["1/b_m"] if adaptation.inverse is not None and not adaptation.inverse.gain > 0 else []
    told = f"{', '.join(still)}: estimated with a gain of 0, so V falls only if the guess is right"
    return told if still else ""


def unfit_gains(derivation: Derivation, values: Mapping[str, float]) -> list[str]:
    """Conditions of the certificate that the gains violate: positive gains and input scale, A0 Hurwitz."""
    faults = [
        f"gain {name} = {values[name]:g} is not positive"
        for name in (*positive_gains(derivation.plant.rho), OBSERVER, INPUT_SCALE)
        if name in values and not values[name] > 0
    ]
    poles = np.linalg.eigvals(numeric(filter_matrix(derivation.signals), values))
    if not np.all(poles.real < 0):
        faults.append(f"A0 is not Hurwitz: poles {poles_text(poles, 4)}")
    return faults


def remainder_text(derivation: Derivation) -> str:
    """The terms dropped from the bound of V', as a sum of squares."""
    return f"squares given away: {' + '.join(str(square) for square in given_away(derivation))}"


def _difference(identity: Identity) -> Difference:
    text = str(identity.remainder)
    shown = text if len(text) <= LONGEST else f"{text[:LONGEST]} ... ({len(text)} characters)"
    return Difference(identity.name, identity.claim, "", "0", shown, "what is left after expansion", "0")
