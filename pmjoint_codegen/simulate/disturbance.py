"""The disturbance D of (12) along a run, and the muscle pressures compared with their limits.

D is the difference between the simulated plant and the design's model: the disturbance that ``[plant]``
states or, for a joint, all physics that the design does not keep; and, where the plant's parameters differ
from the controller's, the model mismatch. The design presumes |D| <= D_max (9).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.simulate.estimates import guesses
from pmjoint_codegen.values import of_plant

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

MUSCLES: Final = ("P1", "P2")
FORCES: Final = ("F1", "F2")  # of a joint whose muscles are not those of the paper
ROUNDING: Final = 1e-9  # of P_max: a pressure that only reaches a limit, to rounding, is not clipped


@dataclass(frozen=True)
class Pressure:
    """One muscle's pressure along a run, at the output instants.

    Attributes:
        least: Pa.
        greatest: Pa.
        wanted_least: least command ``P_0 -+ k_u u``, Pa; below 0 it is clipped.
        wanted_greatest: greatest command, Pa; above `limit` it is clipped.
        limit: P_max, Pa.
    """

    least: float
    greatest: float
    wanted_least: float
    wanted_greatest: float
    limit: float

    @property
    def clipped(self) -> bool:
        """Whether the command exceeded the limits of the muscle or the supply."""
        return (
            self.wanted_least < -ROUNDING * self.limit or self.wanted_greatest > (1 + ROUNDING) * self.limit
        )


def disturbance_names(run: Record) -> tuple[str, ...]:
    """Columns D1 ... Dn of a run."""
    known = {item.name for item in run.manifest.signals}
    return tuple(name for name in (f"D{i}" for i in range(1, run.manifest.n + 1)) if name in known)


def disturbance_norm(run: Record) -> Array:
    """|D|, the Euclidean norm over the components, at the output instants, shape (rows,)."""
    columns = [run[name] for name in disturbance_names(run)]
    with np.errstate(over="ignore"):  # a failed run may end in overflow
        norm: Array = np.sqrt(sum((column**2 for column in columns), np.zeros(len(run.t))))
    return norm


def mismatched(run: Record) -> tuple[str, ...]:
    """What the plant has of its own and the controller takes for something else, for good.

    Parameters that differ, by the name of the plant's own, ``J_plant``; and entries that are guessed and not
    estimated, ``d1``.
    """
    stated = run.manifest.stated(run.settings.parameters)
    own = (name for name in stated if name in run.manifest.own)
    wrong = (item.of for item in guesses(run) if item.kept and item.truth != item.value)
    return (*own, *wrong)


def pressures(run: Record) -> Mapping[str, Pressure]:
    """Pressures of the two muscles; empty where the model is no joint."""
    known = {item.name for item in run.manifest.signals}
    values = run.settings.parameters
    if not known.issuperset(MUSCLES) or MUSCLES[0] in run.manifest.start.names or not len(run.t):
        return {}
    k0, u0, k_u, limit = (of_plant(values, name) for name in ("k0", "u0", "k_u", "P_max"))
    base = k0 * u0
    return {
        name: Pressure(
            least=float(run[name].min()),
            greatest=float(run[name].max()),
            wanted_least=float((base + side * k_u * run["u"]).min()),
            wanted_greatest=float((base + side * k_u * run["u"]).max()),
            limit=limit,
        )
        for name, side in zip(MUSCLES, (1, -1), strict=True)
    }


def forces(run: Record) -> Mapping[str, tuple[float, float]]:
    """Least and greatest force of each muscle in N; empty where a run does not report them."""
    known = {item.name for item in run.manifest.signals}
    if not known.issuperset((*MUSCLES, *FORCES)) or not len(run.t):
        return {}
    return {name: (float(run[name].min()), float(run[name].max())) for name in FORCES}


def disturbance_summary(run: Record) -> dict[str, Any]:
    """The entries of ``summary.json`` on D and the muscles, all at the output instants.

    ``disturbance_max`` is the largest |D|, as bounded by (9), null if no bound is presumed and components
    of several units act; ``disturbance_range`` holds least and greatest value of each component;
    ``disturbance_max_components`` its largest magnitude; ``disturbance_bound`` the D_max that the model file
    presumes, or null. ``pressures`` holds least, greatest, the range commanded, and whether that was clipped,
    in Pa, or null if the model is no joint. ``forces`` holds the same of the muscles' forces in N, where a
    run reports them.
    """
    muscles = {
        name: {
            "min": item.least,
            "max": item.greatest,
            "commanded": [item.wanted_least, item.wanted_greatest],
            "P_max": item.limit,
            "clipped": item.clipped,
        }
        for name, item in pressures(run).items()
    }
    found = forces(run)
    return {
        "disturbance_max": _largest(disturbance_norm(run)) if _is_one_quantity(run) else None,
        "disturbance_range": {name: _range(run[name]) for name in disturbance_names(run)},
        "disturbance_max_components": {name: _largest(run[name]) for name in disturbance_names(run)},
        "disturbance_bound": run.manifest.disturbance_bound,
        "pressures": muscles or None,
        **(
            {"forces": {name: {"min": low, "max": high} for name, (low, high) in found.items()}}
            if found
            else {}
        ),
    }


def _is_one_quantity(run: Record) -> bool:
    """Whether |D| is meaningful: rad/s and rad/s^2 cannot be added."""
    acting = [name for name in disturbance_names(run) if np.any(run[name] != 0.0)]
    return run.manifest.disturbance_bound is not None or len(acting) < 2


def _range(values: Array) -> list[float | None]:
    """Least and greatest value; None if JSON cannot represent it."""
    ends = (float(np.min(values, initial=np.inf)), float(np.max(values, initial=-np.inf)))
    return [end if np.isfinite(end) else None for end in ends]


def _largest(values: Array) -> float | None:
    """Largest magnitude; None if JSON cannot represent it."""
    size = float(np.max(np.abs(values), initial=0.0))
    return size if np.isfinite(size) else None
