"""Proof: the certificate of the model at hand: identities that expand to zero, and definite matrices."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmjoint_codegen.check.oracles.certificate import certify, numeric
from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_derive import Derivation
from pmjoint_derive.consistency import consistency_identities
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.lyapunov import Identity, given_away, prove

LONGEST = 300  # characters of a remainder that a report shows


def check(subject: Subject) -> GateResult:
    """Prove the certificate with symbolic gains, then evaluate it for the model's own."""
    return prove_for(subject.derivation, design_values(subject.derivation))


def design_values(derivation: Derivation) -> dict[str, float]:
    """Every parameter and gain of the model by name."""
    model, s = derivation.model, derivation.signals
    values = {item.name: item.value for item in model.parameters}
    gains = {"c": s.c, "e": s.e, "ck": s.ck, "k": s.k}
    for stem, symbols in gains.items():
        values |= {
            symbol.name: float(value)
            for symbol, value in zip(symbols, getattr(model.gains, stem), strict=True)
        }
    return values


def prove_for(derivation: Derivation, values: Mapping[str, float]) -> GateResult:
    """All statements of the certificate for one design.

    Args:
        derivation: the design.
        values: parameters and gains.
    """
    identities = (*prove(derivation), *consistency_identities(derivation))
    broken = [item for item in identities if not item.holds]
    if broken:
        names = ", ".join(item.name for item in broken)
        detail = f"{len(broken)} of {len(identities)} identities do not expand to zero: {names}"
        return failed(detail, len(broken), 0, _difference(broken[0]))
    faults = unfit_gains(derivation, values)
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


def unfit_gains(derivation: Derivation, values: Mapping[str, float]) -> list[str]:
    """What the certificate needs of the gains, and these do not give: positive ones, A0 Hurwitz."""
    s = derivation.signals
    faults = [
        f"gain {g.name} = {values[g.name]:g} is not positive"
        for g in (*s.c, *s.e, *s.ck)
        if not values[g.name] > 0
    ]
    poles = np.linalg.eigvals(numeric(filter_matrix(s), values))
    if not np.all(poles.real < 0):
        faults.append(f"A0 is not Hurwitz: poles {', '.join(f'{pole:.4g}' for pole in poles)}")
    return faults


def remainder_text(derivation: Derivation) -> str:
    """What V' gives away, as the sum of squares that it is."""
    return f"squares given away: {' + '.join(str(square) for square in given_away(derivation))}"


def _difference(identity: Identity) -> Difference:
    text = str(identity.remainder)
    shown = text if len(text) <= LONGEST else f"{text[:LONGEST]} ... ({len(text)} characters)"
    return Difference(identity.name, identity.claim, "", "0", shown, "what is left after expansion", "0")
