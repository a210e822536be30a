"""The paper's last sentence: its future work, which `pmjoint_derive.adaptive` is.

The runs are those of the model ``paper-adaptive``: the example of Section V with guesses in place of b_0 and
d_1. Frozen, the same controller keeps its guesses.
"""

from __future__ import annotations

import numpy as np

from pmjoint_codegen.audit.context import Context
from pmjoint_codegen.audit.findings import Evidence, Finding
from pmjoint_codegen.audit.judgement import Verdict
from pmjoint_codegen.audit.runs import Experiments, late_peak
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.workspace import find_model
from pmjoint_derive import derive

MODEL = "paper-adaptive"


def future_work(context: Context, made: Experiments) -> Finding:
    """Whether unknown parameters can be estimated here, under saturation, with a proof."""
    path = find_model(MODEL)
    derivation = derive(model_of(read_document(path), str(path)))
    identities = derivation.design.prove(derivation)
    proved = all(item.holds for item in identities)
    adapted, frozen, quiet = made.adapted, made.frozen, made.quiet
    V, entries = quiet["V"], derivation.model.adaptation
    assert entries is not None
    rises = float(np.max(np.diff(V)) / V[0])
    guesses = ", ".join(f"{item.name} = {item.guess:g}" for item in entries.unknown)
    ends = [
        Evidence(f"{item.estimate} at the end", float(adapted[str(item.estimate)][-1]))
        for item in entries.unknown
    ]
    return Finding(
        "future work",
        "estimation of the unknown parameters, and an adaptive scheme",
        Verdict.FOLLOWS if proved and rises < 1e-12 else Verdict.FAILS,
        "can be done: with tuning functions and the same compensator V does not rise, saturated or not",
        evidence=(
            Evidence(
                "identities of its proof that expand to zero",
                f"{sum(i.holds for i in identities)} of {len(identities)}",
            ),
            Evidence("guesses", guesses),
            Evidence(
                "integral of e^2, true parameters known",
                float(made.with_compensator.summary["ise"]),
                "rad^2 s",
            ),
            Evidence("integral of e^2, guesses kept", float(frozen.summary["ise"]), "rad^2 s"),
            Evidence(
                "integral of e^2, estimated from these guesses", float(adapted.summary["ise"]), "rad^2 s"
            ),
            Evidence("largest late |e|, guesses kept", late_peak(frozen, "e"), "rad"),
            Evidence("largest late |e|, estimated", late_peak(adapted, "e"), "rad"),
            *ends,
            Evidence(
                "so the estimates are no identified parameters: true b_0", frozen.settings.parameters["b0"]
            ),
            Evidence("without disturbance: V at the start", float(V[0])),
            Evidence("and at the end", float(V[-1])),
            Evidence("its largest rise from row to row, over V(0)", rises),
        ),
    )
