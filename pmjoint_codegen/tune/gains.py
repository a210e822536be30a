"""The search space: gains on a logarithmic scale within bounds, filter gains via the poles of A0.

The filter gains k of (14) must make ``A0 = A - k e1'`` Hurwitz. So the search moves its poles, in pairs:
``s^2 + 2 damping w s + w^2`` with w > 0 (``pole1``, ``pole2`` ..., in rad/s) and damping > 0 (``damping1``
...), and for odd n one real pole ``s + w``. Every point is Hurwitz. If k1.. themselves are searched,
points that are not Hurwitz are refused one by one.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import UsageError, quoted
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.misplaced import advice
from pmjoint_codegen.values import GAINS, OBSERVER, filter_gains, gain_names

REACH: Final = 5.0  # default bounds: the model's value divided and multiplied by this
DAMPING: Final = (0.3, 2.0)  # from an oscillatory pair of poles to two real ones, 1 : 14 apart
DIGITS: Final = 5  # of a gain: the tried value is the written value
DEFAULT: Final = (*(kind.name for kind in GAINS if not kind.of_filters), "poles")
OFFERED: Final = (
    "--x0",
    "--reference",
    "--horizon",
    "--controller",
    "--sample-time",
    "--start",
    "--saturation",
)
_GAIN: Final = re.compile(r"\s*([A-Za-z]\w*)\s*(?:=([^:]+):([^:]+))?")


@dataclass(frozen=True)
class Bound:
    """One coordinate of the search.

    Attributes:
        name: of a gain, or ``pole1``, ``damping1`` ...
        low: > 0.
        high: > low.
        start: the model's value, moved into the bounds.
    """

    name: str
    low: float
    high: float
    start: float


@dataclass(frozen=True)
class Space:
    """All coordinates.

    Attributes:
        bounds: of every coordinate.
        n: order of the plant.
    """

    bounds: tuple[Bound, ...]
    n: int

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.bounds)

    @property
    def start(self) -> Array:
        """The model's own design, or the nearest point, shape (size,), logarithms."""
        return np.log([bound.start for bound in self.bounds])

    @property
    def limits(self) -> Array:
        """Shape (size, 2), logarithms."""
        return np.log([(bound.low, bound.high) for bound in self.bounds])

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of all gains that the search can change."""
        direct = tuple(bound.name for bound in self.bounds if not _is_polar(bound.name))
        return (*direct, *(filter_gains(self.n) if len(direct) < self.size else ()))

    def decode(self, points: Array) -> dict[str, Array]:
        """Gains of some points.

        Args:
            points: shape (points, size), logarithms.

        Returns:
            name -> shape (points,), rounded to `DIGITS` digits.
        """
        values = dict(zip((bound.name for bound in self.bounds), np.exp(points.T), strict=True))
        gains = {name: value for name, value in values.items() if not _is_polar(name)}
        if len(gains) < self.size:
            gains |= _filter_gains(values, self.n)
        return {name: rounded(value) for name, value in gains.items()}


def rounded(values: Array) -> Array:
    """Positive numbers at `DIGITS` significant digits, as decimals that round-trip."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in values.tolist()])


def make_space(manifest: Manifest, wanted: tuple[str, ...]) -> Space:
    """Read which gains are searched.

    Args:
        manifest: the model.
        wanted: ``NAME`` or ``NAME=LOW:HIGH``; a NAME is a gain, or c, e, ck, k, poles, damping for all of a
            kind. Empty: c, e, ck and poles, or c and observer, as the law has them.

    Raises:
        UsageError: one that cannot be parsed, a name given twice, no such gain, or k together with poles.
    """
    known = _groups(manifest)
    found: dict[str, Bound] = {}
    for text in wanted or (name for name in (*DEFAULT, OBSERVER) if name in known):
        name, ends = _read(text)
        if name not in known:
            raise UsageError(
                f"{manifest.name} has no gain {name!r}",
                where="--gain",
                remedy=advice(manifest, name, known, offered=OFFERED),
            )
        for member in known[name]:
            if member in found:
                raise UsageError(f"{member} is given twice", where="--gain", remedy="give each gain once")
            found[member] = _bound(manifest, member, ends)
    return Space(_complete(manifest, found), manifest.n)


def _groups(manifest: Manifest) -> dict[str, tuple[str, ...]]:
    """Every allowed name, with its coordinates."""
    own = {*manifest.parameter_names}
    groups = {kind.name: kind.names(manifest.n, manifest.rho) for kind in GAINS}
    groups = {name: members for name, members in groups.items() if own.issuperset(members)}
    if OBSERVER in own:
        return groups | {name: (name,) for name in (*groups["c"], OBSERVER)}
    groups |= {
        "poles": gain_names(("pole",), (manifest.n + 1) // 2),
        "damping": gain_names(("damping",), manifest.n // 2),
    }
    return groups | {name: (name,) for members in groups.values() for name in members}


def _read(text: str) -> tuple[str, tuple[float, float] | None]:
    match = _GAIN.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        if match[2] is None:
            return match[1], None
        low, high = float(match[2]), float(match[3])
        if not 0 < low < high < math.inf:
            raise ValueError
    except ValueError:
        raise UsageError(
            f"is {quoted(text)}",
            where="--gain",
            remedy="allowed: NAME or NAME=LOW:HIGH with 0 < LOW < HIGH, such as c1=2:60",
        ) from None
    return match[1], (low, high)


def _bound(manifest: Manifest, name: str, ends: tuple[float, float] | None) -> Bound:
    value = _present(manifest)[name]
    if ends is None:
        ends = DAMPING if name.startswith("damping") else (value / REACH, value * REACH)
        if value <= 0:
            raise UsageError(
                f"{name} is {value:g} in the model, so no default bounds follow",
                where="--gain",
                remedy=f"give bounds: {name}=LOW:HIGH, or search poles instead of k",
            )
    return Bound(name, *ends, start=min(max(value, ends[0]), ends[1]))


def _complete(manifest: Manifest, found: dict[str, Bound]) -> tuple[Bound, ...]:
    """All poles belong together: if one is searched, so are the others."""
    if any(_is_polar(name) for name in found):
        if any(re.fullmatch(r"k\d+", name) for name in found):
            raise UsageError(
                "k and the poles of A0 are the same gains", where="--gain", remedy="search one of them"
            )
        groups = _groups(manifest)
        for name in (*groups["poles"], *groups["damping"]):
            if name not in found:
                found[name] = _bound(manifest, name, None)
    return tuple(found.values())


def _is_polar(name: str) -> bool:
    return name.startswith(("pole", "damping"))


def _present(manifest: Manifest) -> dict[str, float]:
    """The model's value of every coordinate."""
    values = {item.name: float(item.value) for item in manifest.parameters if item.kind == "gain"}
    if OBSERVER in values:
        return values
    roots = np.asarray(
        np.roots([1.0, *(values[name] for name in filter_gains(manifest.n))]), dtype=np.complex128
    )
    for i, pair in enumerate(_pairs(roots), start=1):
        size = math.sqrt(abs(pair[0] * pair[-1]))
        values[f"pole{i}"] = size
        if len(pair) == 2:
            values[f"damping{i}"] = -float((pair[0] + pair[1]).real) / (2 * size)
    return values


def _pairs(roots: npt.NDArray[np.complex128]) -> list[list[complex]]:
    """Complex pairs and pairs of real roots, slow ones first, the odd real root last."""
    upper = sorted((complex(root) for root in roots if root.imag > 0), key=abs)
    real = sorted((complex(root) for root in roots if root.imag == 0), key=abs)
    pairs = [[root, root.conjugate()] for root in upper]
    return pairs + [real[i : i + 2] for i in range(0, len(real), 2)]


def _filter_gains(values: dict[str, Array], n: int) -> dict[str, Array]:
    """Gains k of ``s^n + k1 s^(n-1) + ... + kn``, from its poles."""
    polynomial = np.ones((len(values["pole1"]), 1))
    with np.errstate(over="ignore", invalid="ignore"):  # such a design is refused
        for i in range(1, (n + 1) // 2 + 1):
            w = values[f"pole{i}"]
            if f"damping{i}" in values:
                factor = np.stack([np.ones_like(w), 2 * values[f"damping{i}"] * w, w**2], axis=1)
            else:
                factor = np.stack([np.ones_like(w), w], axis=1)
            polynomial = np.stack([np.convolve(a, b) for a, b in zip(polynomial, factor, strict=True)])
    return {f"k{i}": polynomial[:, i] for i in range(1, n + 1)}
