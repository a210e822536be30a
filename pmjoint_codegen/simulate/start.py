"""X(0) of a run: the plant's states from x0, and the controller's, at rest or matched."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import is_looped, make_chain
from pmjoint_codegen.simulate.settings import Settings
from pmjoint_codegen.values import MATCHED


def initial_state(evaluator: Evaluator, settings: Settings) -> Array:
    """X(0), shape (nX,): the plant at x0, the controller as `Settings.start` says."""
    return make_start(evaluator, settings, columns_of(settings))


def columns_of(settings: Settings) -> dict[str, Array]:
    """Parameters by name, each of shape (1,)."""
    return {name: np.array([value]) for name, value in settings.parameters.items()}


def make_start(evaluator: Evaluator, settings: Settings, columns: Mapping[str, Array]) -> Array:
    """`initial_state` with the parameters by name, each of shape (1,)."""
    manifest = evaluator.manifest
    state = np.zeros(manifest.nX)
    state[: manifest.nx] = manifest.start.states(settings.x0[np.newaxis], columns)
    state[manifest.nx :] = manifest.start.at_rest(columns, 1)
    if settings.start == MATCHED:
        y = state[:1]
        if settings.controller == "sampled" and is_looped(manifest):
            chain = make_chain(manifest, settings.parameters, settings.sample_time)
            y = np.array([chain.read(float(y[0]), 0)])
        y_r = evaluator.call("reference", [0.0], settings.p)[0]
        state[manifest.nx :] = evaluator.call("start", y, y_r, settings.p)[0]
    return state
