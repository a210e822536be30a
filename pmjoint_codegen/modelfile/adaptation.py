"""``[adaptation]``: its keys; `pmjoint_codegen.modelfile.estimates` has what they mean for a plant."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from pmjoint_codegen.modelfile.tables import Number, Numbers, Positive, Table

LEAKAGE: Final = 0.01  # a pull that brings an estimate back from the end of its range
KAPPA: Final = 100.0  # 1/s
FORGETTING: Final = 0.5  # 1/s
P0: Final = 5.0
OF_TRACE: Final = 10.0  # k_max over the initial trace
INVERSE: Final = "inverse"
LEAST_SQUARES: Final = "least_squares"

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

_UNITS = (
    "entries of b in the unit of y over s^k and that of u, w in that of y over s^n, others as the law uses "
    "them: as written in [plant], in SI units in [joint] and [system]"
)


class InverseSpec(Table):
    """``inverse``: the estimate of 1/b_m of the form "inverse"."""

    guess: Number | None = Field(default=None, description="a finite number; by default 1/guess of b_m")
    gain: NotNegative | None = Field(
        default=None,
        description="a finite number, 0 or greater; by default 0.3 times the square of half the range of "
        "1/b_m",
    )
    leakage: NotNegative | None = Field(
        default=None, description="a finite number, 0 or greater; by default adaptation.leakage"
    )
    prior: Number | None = Field(default=None, description="a finite number; by default the guess")


class LeastSquaresSpec(Table):
    """``least_squares``: the estimator of that name."""

    kappa: Positive = Field(
        default=KAPPA, description=f"a finite number of 1/s greater than 0; by default {KAPPA:g}"
    )
    forgetting: NotNegative = Field(
        default=FORGETTING, description=f"a finite number of 1/s, 0 or greater; by default {FORGETTING:g}"
    )
    P0: Positive = Field(default=P0, description=f"a finite number greater than 0; by default {P0:g}")
    k_max: Positive | None = Field(
        default=None,
        description="a finite number, at least P0 times the number of unknown entries; by default "
        f"{OF_TRACE:g} times that",
    )


class AdaptationSpec(Table):
    """``[adaptation]``: what the controller does not know. Names are those of `entries.slots_of`."""

    unknown: tuple[str, ...] | None = Field(
        default=None, description='a list of names of b and theta, such as ["b0", "d1"]'
    )
    load: bool = Field(
        default=False,
        description="true or false; true adds a constant load: the column e_n of Phi, the entry w of theta",
    )
    form: Literal["divide", "inverse"] = Field(default="divide", description='"divide" or "inverse"')
    guess: dict[str, Number] = Field(
        default={},
        description=f"a table of finite numbers, such as {{ b0 = 1.2 }}, {_UNITS}; by default the values at "
        "the file's parameters, and 0 for w",
    )
    range: dict[str, Numbers] = Field(
        default={},
        description="a table of pairs [least, greatest], such as { b0 = [0.3, 6.0] }, in the units of guess",
    )
    gain: dict[str, NotNegative] = Field(
        default={},
        description="a table of finite numbers, 0 or greater, such as { b0 = 1.0 }, in the units of guess "
        "squared over that of y squared; by default 4 times the square of half the range for w, 0.3 times "
        "that square for others",
    )
    leakage: NotNegative | None = Field(
        default=None, description=f"a finite number, 0 or greater; by default {LEAKAGE:g}"
    )
    prior: dict[str, Number] = Field(
        default={},
        description="a table of finite numbers, in the units of guess; by default the guesses",
    )
    inverse: InverseSpec | None = Field(
        default=None, description="a table with guess, gain, leakage and prior of the estimate of 1/b_m"
    )
    estimator: Literal["tuning", "least_squares"] = Field(
        default="tuning", description='"tuning" or "least_squares"'
    )
    least_squares: LeastSquaresSpec | None = Field(
        default=None, description="a table with kappa, forgetting, P0 and k_max"
    )
    force: bool = Field(
        default=False, description="true or false; true allows plain clipping, which can destroy the loop"
    )

    @property
    def names_unknown(self) -> tuple[str, ...]:
        """Names of what is estimated: the load alone, where the file says no more than ``load = true``."""
        if self.unknown is None:
            return ("w",) if self.load else ()
        return self.unknown
