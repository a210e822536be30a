"""What a controller does not know of its plant: guesses, and how it estimates.

The unknown vector is ``Theta = (b_m, ..., b_0, theta)``. An entry with a guess has two values: the plant's
own, and what the controller takes for it. The controller starts from the guess and stays there, or, where the
entry is unknown, estimates it from there on.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.equation import real_symbol


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
        P0: initial diagonal of Gamma, greater than 0.
        k_max: trace of Gamma at which nothing more is forgotten.
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
