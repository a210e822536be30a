"""What a controller does not know of its plant: guesses, and how it estimates.

The unknown vector is ``Theta = (b_m, ..., b_0, theta)``. An entry with a guess has two values: the plant's
own, and what the controller takes for it. The controller starts from the guess and stays there, or, where the
entry is unknown, estimates it from there on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.equation import real_symbol
from pmjoint_derive.units import SECOND, Unit, parse_unit

LEAKAGE = real_symbol("leakage")
RHO_HAT = real_symbol("rho_hat")
RHO_GUESS, RHO_GAMMA, RHO_LEAKAGE, RHO_PRIOR = map(
    real_symbol, ("rho_guess", "gamma_rho", "rho_leakage", "rho_prior")
)
LS_KAPPA, LS_FORGETTING, LS_P0, LS_K_MAX = map(
    real_symbol, ("ls_kappa", "ls_forgetting", "ls_P0", "ls_k_max")
)


@dataclass(frozen=True)
class Entry:
    """One entry of Theta that the controller has its own value of.

    Attributes:
        name: of the entry: ``b0``, ``d1``, ``w``.
        place: index in Theta, ``b_m`` first.
        guess: where the estimate starts; what the controller uses for good where the entry is not unknown.
        unknown: whether it is estimated.
        range: open interval that the estimate never leaves; None: the gain is constant.
        gain: gamma of the estimate, 0 or greater.
        prior: where leakage pulls the estimate to.
        unit: of the entry, for the reader.
        about: what it is, for the reader.
    """

    name: str
    place: int
    guess: float
    unknown: bool = False
    range: tuple[float, float] | None = None
    gain: float = 0.0
    prior: float = 0.0
    unit: str = ""
    about: str = ""

    @property
    def guess_symbol(self) -> sp.Symbol:
        """The run-time parameter of the guess, ``b0_guess``."""
        return real_symbol(f"{self.name}_guess")

    @property
    def estimate(self) -> sp.Symbol:
        """The estimate ``b0_hat``."""
        return real_symbol(f"{self.name}_hat")

    @property
    def state(self) -> sp.Symbol:
        """What is integrated: the estimate or, with a range, its logit ``b0_logit``, which has no ends."""
        return self.estimate if self.range is None else real_symbol(f"{self.name}_logit")

    @property
    def gamma(self) -> sp.Symbol:
        """The run-time parameter of the gain, ``gamma_b0``."""
        return real_symbol(f"gamma_{self.name}")

    @property
    def prior_symbol(self) -> sp.Symbol:
        """The run-time parameter ``b0_prior``."""
        return real_symbol(f"{self.name}_prior")

    @property
    def ends(self) -> tuple[sp.Symbol, sp.Symbol]:
        """The run-time parameters of the range, ``b0_low`` and ``b0_high``."""
        return real_symbol(f"{self.name}_low"), real_symbol(f"{self.name}_high")


@dataclass(frozen=True)
class Inverse:
    """An estimate ``rho_hat`` of ``1/b_m``, which the law then multiplies by instead of dividing by b_m's.

    Attributes:
        guess: where it starts.
        gain: gamma_rho, 0 or greater.
        leakage: 1/s over the gain, 0 or greater.
        prior: where leakage pulls it to.
    """

    guess: float
    gain: float
    leakage: float
    prior: float


@dataclass(frozen=True)
class LeastSquares:
    """Least squares with forgetting in place of tuning functions: its gain matrix Gamma is a state.

    Attributes:
        kappa: weight of the prediction error, 1/s, greater than 0.
        forgetting: beta, 1/s, 0 or greater.
        P0: initial diagonal of Gamma, 0 or greater; from 0 the estimates stay at their guesses.
        k_max: trace of Gamma at which nothing more is forgotten, greater than 0.
    """

    kappa: float
    forgetting: float
    P0: float
    k_max: float


@dataclass(frozen=True)
class Adaptation:
    """How a controller that does not know some entries of Theta gets on.

    Attributes:
        entries: those with a guess, in the order of Theta.
        leakage: pull towards the priors, 0 or greater; it acts within the gain.
        inverse: the estimate of 1/b_m; None: the law divides by that of b_m.
        least_squares: None: tuning functions.
        force: whether plain clipping is allowed with it.
    """

    entries: tuple[Entry, ...]
    leakage: float = 0.0
    inverse: Inverse | None = None
    least_squares: LeastSquares | None = None
    force: bool = False

    @property
    def unknown(self) -> tuple[Entry, ...]:
        """The entries that are estimated."""
        return tuple(entry for entry in self.entries if entry.unknown)

    @property
    def ranged(self) -> tuple[Entry, ...]:
        """Those of them with a range: their states are their logits."""
        return tuple(entry for entry in self.unknown if entry.range is not None)

    @property
    def sign(self) -> int:
        """Sign of b_m, which the controller must know: that of its guess."""
        leading = self.entry_at(0)
        return -1 if leading is not None and leading.guess < 0 else 1

    def entry_at(self, place: int) -> Entry | None:
        """The entry at an index of Theta, if the controller has its own value of it."""
        return next((entry for entry in self.entries if entry.place == place), None)

    @property
    def covariance(self) -> tuple[tuple[sp.Symbol, ...], ...]:
        """The symmetric gain matrix of least squares, ``Gamma11``, ``Gamma12``, ...; empty without it."""
        if self.least_squares is None:
            return ()
        size = range(1, len(self.unknown) + 1)
        return tuple(tuple(real_symbol(f"Gamma{min(i, j)}{max(i, j)}") for j in size) for i in size)


@dataclass(frozen=True)
class Setting:
    """A number of the controller's that belongs to guesses and estimates, settable for a run.

    Attributes:
        symbol: of the run-time parameter.
        value: default.
        unit: physical unit, None where it has none that one label could say.
        about: one line for the reader.
    """

    symbol: sp.Symbol
    value: float
    unit: Unit | None
    about: str


def settings_of(adaptation: Adaptation | None, y: Unit) -> tuple[Setting, ...]:
    """The run-time parameters of guesses and estimates, in the order of the parameter vector.

    Args:
        adaptation: None has none.
        y: unit of the output.
    """
    if adaptation is None:
        return ()
    return tuple(_settings(adaptation, y))


def _settings(adaptation: Adaptation, y: Unit) -> Iterator[Setting]:
    tuned = adaptation.least_squares is None
    for entry in adaptation.entries:
        unit = parse_unit(entry.unit)
        yield Setting(entry.guess_symbol, entry.guess, unit, f"{entry.name} as the controller first takes it")
        if entry.unknown and entry.range is not None:
            for symbol, end, which in zip(entry.ends, entry.range, ("least", "greatest"), strict=True):
                yield Setting(symbol, end, unit, f"end of the range of {entry.estimate}: {which}")
        if entry.unknown and tuned:
            about = f"adaptation gain of {entry.estimate}"
            yield Setting(entry.gamma, entry.gain, unit**2 / y**2, about)
            yield Setting(entry.prior_symbol, entry.prior, unit, f"where leakage pulls {entry.estimate}")
    if adaptation.unknown and tuned:
        yield Setting(LEAKAGE, adaptation.leakage, None, "pull of the estimates towards their priors")
    if adaptation.inverse is not None:
        yield from _of_inverse(adaptation, adaptation.inverse, y)
    if adaptation.least_squares is not None:
        found = adaptation.least_squares
        yield Setting(LS_KAPPA, found.kappa, SECOND**-1, "weight of the prediction error")
        yield Setting(LS_FORGETTING, found.forgetting, SECOND**-1, "rate at which data are forgotten")
        yield Setting(LS_P0, found.P0, None, "initial diagonal of the gain matrix")
        yield Setting(LS_K_MAX, found.k_max, None, "trace of the gain matrix at which nothing is forgotten")


def _of_inverse(adaptation: Adaptation, inverse: Inverse, y: Unit) -> Iterator[Setting]:
    unit = inverse_unit(adaptation)
    yield Setting(RHO_GUESS, inverse.guess, unit, "1/b_m as the controller first takes it")
    yield Setting(RHO_GAMMA, inverse.gain, unit / y**2, "adaptation gain of rho_hat")
    yield Setting(RHO_LEAKAGE, inverse.leakage, None, "pull of rho_hat towards its prior")
    yield Setting(RHO_PRIOR, inverse.prior, unit, "where leakage pulls rho_hat")


def inverse_unit(adaptation: Adaptation) -> Unit:
    """Unit of the estimate of 1/b_m."""
    leading = adaptation.entry_at(0)
    return Unit({}) if leading is None else parse_unit(leading.unit) ** -1


def adaptation_units(adaptation: Adaptation | None, y: Unit) -> dict[sp.Symbol, Unit]:
    """Units of run-time parameters, estimates and the gain matrix.

    Args:
        adaptation: None has none.
        y: unit of the output.
    """
    if adaptation is None:
        return {}
    table = {item.symbol: item.unit or Unit({}) for item in settings_of(adaptation, y)}
    units = [parse_unit(entry.unit) for entry in adaptation.unknown]
    table |= {entry.state: Unit({}) for entry in adaptation.unknown}
    table |= dict(zip((entry.estimate for entry in adaptation.unknown), units, strict=True))
    table |= {RHO_HAT: inverse_unit(adaptation)}
    for row, one in zip(adaptation.covariance, units, strict=False):
        table |= {symbol: one * other for symbol, other in zip(row, units, strict=True)}
    return table
