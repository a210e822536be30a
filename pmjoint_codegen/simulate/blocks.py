"""Names of states by what they are of."""

from __future__ import annotations

from pmjoint_codegen.manifest import Manifest


def compensator_states(manifest: Manifest) -> tuple[str, ...]:
    """The states of the saturation compensator, in order; a law may have none."""
    first, last = manifest.blocks["r"]
    return tuple(item.name for item in manifest.states[first:last])
