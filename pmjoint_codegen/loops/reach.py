"""How far a state may go before a run ends as diverged.

The logit of an estimate with a range may go anywhere: the estimate stays in its range.
"""

from __future__ import annotations

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import LOGIT, Manifest


def boundless_states(manifest: Manifest) -> tuple[int, ...]:
    """Index in X of each logit."""
    places = range(*manifest.blocks.get("Theta", (0, 0)))
    return tuple(place for place in places if manifest.states[place].name.endswith(LOGIT))


def reach_of(manifest: Manifest, divergence: float) -> Array:
    """What ``|X_i|`` must pass to end a continuous run, shape (nX,).

    Args:
        manifest: of the model.
        divergence: of states other than logits.
    """
    found = np.full(manifest.nX, divergence)
    found[list(boundless_states(manifest))] = np.inf
    return found
