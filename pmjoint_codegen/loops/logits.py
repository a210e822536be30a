"""The states of estimates with a range: their logits, less those of their guesses.

A logit may go anywhere, and the estimate stays in its range.
"""

from __future__ import annotations

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import LOGIT, Manifest


def logit_states(manifest: Manifest) -> tuple[int, ...]:
    """Index in X of each logit."""
    places = range(*manifest.blocks.get("Theta", (0, 0)))
    return tuple(place for place in places if manifest.states[place].name.endswith(LOGIT))


def reach_of(manifest: Manifest, divergence: float) -> Array:
    """What ``|X_i|`` must pass to end a continuous run, shape (nX,).

    Args:
        manifest: of the model.
        divergence: of states other than logits, which may go anywhere.
    """
    found = np.full(manifest.nX, divergence)
    found[list(logit_states(manifest))] = np.inf
    return found


def reported_states(manifest: Manifest) -> tuple[str, ...]:
    """Names of the states as sweeps report them: an estimate for its logit."""
    logits = logit_states(manifest)
    return tuple(
        estimate_name(item.name) if place in logits else item.name
        for place, item in enumerate(manifest.states)
    )


def estimate_name(state: str) -> str:
    """Name of the estimate that a state is of: the state itself, or ``b0_hat`` for ``b0_logit``."""
    return f"{state.removesuffix(LOGIT)}_hat" if state.endswith(LOGIT) else state


def put_estimates(manifest: Manifest, p: Array, X: Array) -> None:
    """Replace each logit by its estimate, strictly inside its range, in place.

    Args:
        manifest: of the model.
        p: parameters, shape (runs, np).
        X: states, shape (runs, nX) or (runs, rows, nX).
    """
    apart = (-1, *[1] * (X.ndim - 2))
    for place in logit_states(manifest):
        name = manifest.states[place].name.removesuffix(LOGIT)
        guess, low, high = (
            p[:, manifest.parameter_names.index(f"{name}_{which}")].reshape(apart)
            for which in ("guess", "low", "high")
        )
        X[..., place] = inside(place_of(X[..., place], guess, low, high), low, high)


def place_of(logit: Array, guess: Array, low: Array, high: Array) -> Array:
    """The estimate at a value of its state; arrays of one shape, or that go together."""
    turn = np.tanh(logit / 2)
    room = 2 * (guess - low) * (high - guess)
    return np.asarray(guess + room * turn / (high - low + (2 * guess - low - high) * turn))


def inside(values: Array, low: Array | float, high: Array | float) -> Array:
    """Numbers of a closed range, those at its ends one double further in.

    The logit of an estimate tells that it is inside where its own digits do not.
    """
    return np.clip(values, np.nextafter(low, high), np.nextafter(high, low))
