"""The proof: the Lyapunov function, its rate with the squares given away, and the constants of this model."""

from __future__ import annotations

from pmjoint_codegen.check.gates.proof import no_certificate
from pmjoint_codegen.check.oracles.certificate import Certificate
from pmjoint_codegen.dossier.chapters.derivation import equation_html
from pmjoint_codegen.dossier.facts import CERTIFICATE, Absent, Decay, Facts
from pmjoint_codegen.dossier.markup import (
    absent,
    chapter,
    code,
    items,
    number,
    paragraph,
    plain,
    prose,
    table,
    tag,
)
from pmjoint_codegen.report.mathml import formula, inline_symbol
from pmjoint_codegen.report.notation import text_expression
from pmjoint_derive.lyapunov import given_away

IDENTITY = (
    "The rate below is an identity: its terms were expanded along the true dynamics, and what remains is "
    "exactly zero."
)


def proof_chapter(facts: Facts) -> str:
    """Statement, equations, squares, constants, and the identities that were expanded to zero."""
    own = [equation_html(item) for item in facts.equations if item.section == CERTIFICATE]
    if not facts.derivation.design.certifies:
        return chapter(
            "proof",
            "Proof",
            paragraph("This law comes without a Lyapunov function. What is proved of it is below."),
            tag("h3", "Identities", id="identities"),
            _identities(facts),
        )
    unclaimed = no_certificate(facts.derivation)
    if unclaimed:
        return _without_claim(facts, unclaimed)
    words = (
        f"{inline_symbol('V')} {_claim(facts)}, whatever the applied input is. "
        f"{IDENTITY} The squares are subtracted, so leaving them out gives an upper bound. They are "
        "squares with positive factors because every gain is positive."
    )
    switched = (
        []
        if facts.subject.model.gains.compensator
        else [
            paragraph(
                tag("strong", "The compensator is off in this model. "),
                "The proof is that of the loop with the compensator; with r = 0 it holds only while the "
                "input is not saturated.",
            )
        ]
    )
    return chapter(
        "proof",
        "Proof",
        paragraph(words),
        *switched,
        tag("h3", "Lyapunov function and rate", id="lyapunov"),
        *own,
        tag("h3", "The squares", id="squares"),
        items(formula(text_expression(square), large=True) for square in given_away(facts.derivation)),
        tag("h3", "Constants of this model", id="constants"),
        _constants(facts.certificate),
        tag("h3", "Identities", id="identities"),
        _identities(facts),
    )


def _without_claim(facts: Facts, reason: str) -> str:
    """The chapter of a design of whose V nothing is claimed; the share of the errors may have a rate."""
    own = [equation_html(item) for item in facts.equations if item.section == CERTIFICATE]
    words = (
        f"{inline_symbol('V_z')} is the share of the errors. {IDENTITY} The errors of the estimates stay in "
        "it, so it says nothing of where they go."
    )
    shown = [tag("h3", "Share of the errors and its rate", id="lyapunov"), paragraph(words), *own]
    return chapter(
        "proof",
        "Proof",
        paragraph(tag("strong", "Nothing is claimed of a Lyapunov function: "), plain(reason), "."),
        *(shown if own else []),
        tag("h3", "Identities", id="identities"),
        _identities(facts),
    )


def _claim(facts: Facts) -> str:
    """What V does: estimates have a share in it that need not decay."""
    if isinstance(facts.certificate, Decay):
        return "decreases up to the effects of the disturbance and of wrong priors"
    if facts.derivation.design.decays:
        return "decreases up to the effect of the disturbance"
    return "does not rise, but for the effects of disturbance and leakage"


def _constants(certificate: Certificate | Decay | Absent) -> str:
    if isinstance(certificate, Absent):
        return absent(certificate.reason)
    if isinstance(certificate, Decay):
        return _learning_constants(certificate)
    poles = ", ".join(_pole(complex(pole)) for pole in certificate.poles)
    P = "; ".join(", ".join(number(float(entry), 5) for entry in row) for row in certificate.P)
    z = inline_symbol("z1")
    rows = [
        ("poles of A<sub>0</sub> (1/s)", poles, "all to the left: the filters are stable"),
        ("P (s), by rows", P, f"positive definite, largest eigenvalue {number(_largest(certificate), 5)}"),
        (inline_symbol("f_minus"), number(certificate.f_minus, 5), "least rate in (32)"),
        (inline_symbol("f_plus"), number(certificate.f_plus, 5), "greatest weight in (30)"),
        ("f (1/s)", number(certificate.f, 4), "V decays at least like exp(−f t)"),
    ]
    if certificate.Y is None:
        rows.append(("Y", "none", "the model states no disturbance_bound, so there is no ultimate bound"))
    else:
        eta = plain(certificate.eta.replace("epsilon_2", "ε₂").replace("D_1", "D₁"))
        rows += [
            ("Y", number(certificate.Y, 4), "what the disturbance adds at most (33)"),
            ("√(2Y/f)", number(certificate.z_bound, 3), f"ultimate bound of |z|, and so of |{z}| (35)"),
            ("sharper bound of |z|", number(certificate.z_sharp, 3), f"through {eta} alone"),
            (f"sharper bound of |{z}|", number(certificate.z1_sharp, 3), f"through {eta} alone"),
        ]
    return table(("constant", "value", "meaning"), rows)


def _learning_constants(decay: Decay) -> str:
    """Rate and residual with estimates in V."""
    rows = [("f (1/s)", number(decay.f, 4), "V decays at least like exp(−f t)")]
    if decay.Y is None:
        rows.append(("Y", "none", "no bound of the disturbance is known, so there is no ultimate bound"))
    else:
        rows += [
            ("Y", number(decay.Y, 4), "what the disturbance and wrong priors add at most"),
            ("Y/f", number(decay.Y / decay.f, 4), "V comes at least down to it"),
        ]
    return table(("constant", "value", "meaning"), rows)


def _pole(pole: complex) -> str:
    if abs(pole.imag) <= 1e-4 * abs(pole.real):  # a multiple pole comes out of its coefficients like this
        return number(pole.real, 4)
    sign = "+" if pole.imag > 0 else "−"
    return f"{number(pole.real, 4)} {sign} {number(abs(pole.imag), 4)} i"


def _largest(certificate: Certificate) -> float:
    import numpy as np

    return float(np.linalg.eigvalsh(certificate.P)[-1])


def _identities(facts: Facts) -> str:
    broken = [item for item in facts.identities if not item.holds]
    count = len(facts.identities)
    told = (
        f"All {count} identities were expanded with symbolic gains and parameters; what remains of each is 0."
        if not broken
        else f"{len(broken)} of {count} identities do not hold: there is no proof."
    )
    rows = [
        (code(item.name), prose(item.claim), "0" if item.holds else tag("strong", "not 0", class_="failed"))
        for item in facts.identities
    ]
    return paragraph(told) + table(("identity", "claim", "remainder"), rows)
