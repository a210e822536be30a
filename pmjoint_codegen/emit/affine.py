"""The linear part of a right-hand side, with as few operations per coefficient as can be found.

Most of a closed loop is linear: filters, compensator, and often the whole law, with parameters and gains as
constants. On the page it is nested, error by error and virtual control by virtual control, and a Taylor
kernel would repeat every line of it for every order. Above order 0 only coefficients of moving quantities
count, so a nested linear expression may be multiplied out: ``v[k] = K1 x1[k] + K2 x2[k] + ...`` with
factors that are computed once per call. Counting operations decides which expressions stay and which are
multiplied into their users.

Two factors are the same, or zero, where their residues modulo two large primes are, with every parameter
replaced by a fixed residue: an identity test that is exact except for a chance of one in 10^18. Modulo the
second prime, a neutral parameter is 1. Operations are counted with that residue only: a parameter that is 1
unless it is set, such as the input scale, changes none of the decisions, and the values at 1 have the same
bits as without it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from hashlib import sha256
from math import gcd
from typing import Final

from pmjoint_codegen.emit.terms import Term, number

PRIME: Final = 2**61 - 1
SECOND: Final = 2**62 - 57
MODULUS: Final = PRIME * SECOND

Entry = tuple[str, int]  # label of a function's input, and index in it
Form = dict[int, int]  # quantity -> residue of its factor


@dataclass(frozen=True)
class Factor:
    """A constant factor, ``sign * term``; `factor` makes it.

    Attributes:
        residue: of the factor, including its sign; it identifies equal factors.
        term: computes its magnitude, up to the sign; 1 where the factor is 1 or -1.
        sign: 1 or -1.
    """

    residue: int
    term: Term
    sign: int

    @property
    def unit(self) -> bool:
        """Whether it is 1 or -1."""
        return unit(self.residue)

    @property
    def neutral(self) -> bool:
        """Whether it is 1 as long as neutral parameters are, and not otherwise."""
        return self.residue % SECOND == 1 and not self.unit

    def __neg__(self) -> Factor:
        """Negative; no operation."""
        return factor(-self.residue % MODULUS, self.term, -self.sign)

    def __mul__(self, other: Factor) -> Factor:
        """Product; with 1 or -1, no operation."""
        residue, sign = self.residue * other.residue % MODULUS, self.sign * other.sign
        if self.unit:
            return factor(residue, other.term, sign)
        return factor(residue, self.term if other.unit else self.term * other.term, sign)

    def inverted(self) -> Factor:
        """The factor's inverse."""
        return factor(inverse(self.residue), number(1.0) / self.term, self.sign)

    def __add__(self, other: Factor) -> Factor:
        """Sum."""
        residue = (self.residue + other.residue) % MODULUS
        if self.sign == other.sign:
            return factor(residue, self.term + other.term, self.sign)
        return factor(residue, self.term - other.term, self.sign)


def factor(residue: int, term: Term, sign: int = 1) -> Factor:
    """A factor from its residue and from what computes it; one that is 1 or -1 needs no computing."""
    if unit(residue):
        return Factor(residue, number(1.0), 1 if residue == 1 else -1)
    return Factor(residue, term, sign)


def unit(residue: int) -> bool:
    """Whether it is the residue of 1 or -1."""
    return residue in (1, MODULUS - 1)


def one() -> Factor:
    """The factor 1."""
    return factor(1, number(1.0))


def residue_of(value: float) -> int:
    """Residue of a double, which is a fraction."""
    exact = Fraction(value)
    return exact.numerator * pow(exact.denominator, -1, MODULUS) % MODULUS


def residue_named(*names: Hashable) -> int:
    """A fixed residue for a quantity known only by name, the same modulo both primes."""
    return int.from_bytes(sha256(repr(names).encode()).digest()[:8], "big") % PRIME


def joined(first: int, second: int) -> int:
    """The residue that is `first` modulo `PRIME` and `second` modulo `SECOND`."""
    return first + PRIME * ((second - first) * pow(PRIME, -1, SECOND) % SECOND)


def residue_of_result(operation: Hashable, *operands: int) -> int:
    """A fixed residue for a result that is no sum, product or quotient, from those of its operands."""
    named = (residue_named(operation, *(value % prime for value in operands)) for prime in (PRIME, SECOND))
    return joined(*named)


def inverse(residue: int) -> int:
    """Residue of 1/a; of 1/0, what is no number's."""
    return pow(residue, -1, MODULUS) if gcd(residue, MODULUS) == 1 else residue_named("1/0", residue)


Combination = dict[int, Factor]  # quantity -> factor


def shortest(forms: Mapping[int, Combination], needed: Iterable[int]) -> dict[int, Combination]:
    """Multiply out linear combinations where that saves operations.

    Args:
        forms: quantity -> the combination that it is, of quantities that may be combinations themselves; each
            comes after those that it combines.
        needed: combinations whose values are required.

    Returns:
        The combinations that remain, needed ones among them, in the same order.
    """
    wanted = set(needed)
    kept = {name: dict(form) for name, form in forms.items()}
    count = _Count(kept.values())
    users: dict[int, set[int]] = {}
    for name, form in kept.items():
        for part in form:
            users.setdefault(part, set()).add(name)
    changed = True
    while changed:
        changed = False
        for name in reversed(list(kept)):
            if name in wanted:
                continue
            using = sorted(users.get(name, ()))
            trial = {user: _inlined(_residues(kept[user]), name, _residues(kept[name])) for user in using}
            gain = count.change([kept[name], *(kept[user] for user in using)], trial.values())
            if gain > 0:
                continue
            form = kept.pop(name)
            count.remove(form)
            for user in using:
                count.remove(kept[user])
                kept[user] = _multiplied_out(kept[user], name, form)
                count.add(kept[user])
                for part in kept[user]:
                    users.setdefault(part, set()).add(user)
            for part in form:
                users[part].discard(name)
            for user in using:
                for part in form:
                    if part not in kept[user]:
                        users[part].discard(user)
            users.pop(name, None)
            changed = True
    return kept


class _Count:
    """Operations that combinations take for one order: their additions, and their distinct products."""

    def __init__(self, forms: Iterable[Combination]) -> None:
        self.products: Counter[tuple[int, int]] = Counter()
        for form in forms:
            self.add(form)

    def add(self, form: Combination) -> None:
        self.products.update(_products(_residues(form)))

    def remove(self, form: Combination) -> None:
        self.products.subtract(_products(_residues(form)))

    def change(self, old: Sequence[Combination], new: Iterable[Form]) -> int:
        """How many more operations there are with `new` in place of `old`."""
        before, after = [_residues(form) for form in old], list(new)
        difference: Counter[tuple[int, int]] = Counter()
        for form in before:
            difference.subtract(_products(form))
        for form in after:
            difference.update(_products(form))
        products = sum(
            (self.products[key] + change > 0) - (self.products[key] > 0)
            for key, change in difference.items()
            if change
        )
        return products + sum(map(_additions, after)) - sum(map(_additions, before))


def _residues(form: Combination) -> Form:
    """Residues modulo `SECOND`, which count; factors that are zero there do not."""
    residues = ((name, factor.residue % SECOND) for name, factor in form.items())
    return {name: residue for name, residue in residues if residue}


def _costs(residue: int) -> bool:
    return residue not in (1, SECOND - 1)


def _products(form: Form) -> list[tuple[int, int]]:
    """Products of a form that cost something; one with the opposite sign is the same."""
    return [(name, min(value, SECOND - value)) for name, value in form.items() if _costs(value)]


def _additions(form: Form) -> int:
    return max(len(form) - 1, 0)


def _inlined(form: Form, name: int, inner: Form) -> Form:
    outer = form.get(name, 0)
    result = {part: value for part, value in form.items() if part != name}
    for part, value in inner.items():
        total = (result.get(part, 0) + outer * value) % SECOND
        if total:
            result[part] = total
        else:
            result.pop(part, None)
    return result


def _multiplied_out(form: Combination, name: int, inner: Combination) -> Combination:
    result = {part: factor for part, factor in form.items() if part != name}
    for part, factor in inner.items():
        product = form[name] * factor
        result[part] = result[part] + product if part in result else product
        if not result[part].residue:
            del result[part]
    return result
