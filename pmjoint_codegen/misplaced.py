"""Advice about a name that is not known where it stands: which option or argument it belongs to."""

from __future__ import annotations

from collections.abc import Container, Iterable
from types import MappingProxyType

from pmjoint_codegen.errors import did_you_mean
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.values import GAINS

_OPTIONS = MappingProxyType(  # what a run can be given besides numbers by name -> its option
    {
        **dict.fromkeys(("y_r", "reference", "r"), "--reference"),
        **dict.fromkeys(("d", "D", "disturbance"), "--disturbance"),
        "horizon": "--horizon",
        "x0": "--x0",
        "sample_time": "--sample-time",
        "output_step": "--output-step",
        "tolerance": "--tolerance",
        "max_step": "--max-step",
        "divergence": "--divergence",
        "controller": "--controller",
        "saturation": "--saturation",
        "start": "--start",
    }
)


def advice(
    manifest: Manifest, name: str, known: Iterable[str], *, offered: Container[str] | None = None
) -> str:
    """What a reader who wrote this name needs instead.

    Args:
        manifest: the model.
        name: that is not among the known ones.
        known: the names that are allowed at this place, in order.
        offered: the options of the command that is asked; None: those of a run.

    Returns:
        Where the name belongs, if it means something elsewhere; else the closest known name, and all of them.
    """
    allowed = tuple(known)
    names = f"names: {', '.join(allowed)}"
    kind = next((kind for kind in GAINS if kind.name == name), None)
    if kind is not None:
        members = [member for member in kind.names(manifest.n, manifest.rho) if member in allowed]
        if members:
            return f"{name} stands for all gains of its kind in tune --gain alone; here: {', '.join(members)}"
    if name in manifest.start.names:
        order = ", ".join(manifest.start.names)
        return f"it is an initial value: give --x0 with {order}, in this order; in a sweep, --grid {name}=..."
    if name in manifest.parameter_names:
        if offered is None or "--set" in offered:
            return f"it is a parameter: give --set {name}=VALUE"
        return f"it stays as it is in the model file; {names}"
    if name in _OPTIONS and (offered is None or _OPTIONS[name] in offered):
        return f"give {_OPTIONS[name]}; {names}"
    return f"{did_you_mean(name, allowed, str)}{names}"
