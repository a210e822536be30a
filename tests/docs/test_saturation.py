"""The designs of docs/saturation.md, against figures that were computed elsewhere, to their digits."""

from __future__ import annotations

import re
from decimal import Decimal

import pytest

from docs import saturation

# By another program: a linear 6-state model of the same joint, integrated in C with fixed steps. It has 7.2
# where 7.27 stands below, which the law written out by hand for y_r = 0 gives with SciPy's LSODA, too.
KNOWN = {
    "paper, ck = 1 (zero)": ("9.42/7.46/226", "6.9, 8.6, lost; 70.17", "2.69 3.59 6.05", "6.95; 6.8", "17.5"),
    "clip (zero)": (".423/1.60/226", "4.7, 19.6, 30.2; 100", "117 1.41 .68", "2.31; lost", "1.03"),
    "clip (matched)": (".381/.74/220", "4.3, 19.5, 30.2; 100", "136 1.02 .55", "2.31; lost", "1.04"),
    "ck = (√d1, 15) (matched)": ("2.46/8.9/3", "8.9, 9.7, 12.6; 100", "2.43 2.46 2.46", "8.8; 9.3", "4.10"),
    "ck = 1 (matched)": ("1.57/4.95/.6", "5.8, 6.5, 9.7; 100", "1.57 1.57 1.57", "5.8; 6.1", "4.08"),
    "ck = 3 (matched)": (".778/1.86/4", "2.2, 4.1, 8.7; 100", ".89 .81 .78", "2.00; lost", "1.62"),
    "ck = 12 (zero)": (".387/1.60/226", "3.3, 13.1, 21.7; 100", "1.38 .87 .53", "1.68; lost", "1.03"),
    "ck = 12 (matched)": (".386/.58/96", "3.0, 13.0, 21.7; 100", "1.06 .74 .49", "1.68; lost", "1.06"),
    "braking 12, 0.5 (matched)": (".418/.63/26", "1.6, 4.0, 7.8; 100", ".92 .74 .54", "1.11; 3.4", "1.09"),
    "braking 12, 0.7 (matched)": (".402/.59/32", "1.4, 3.7, 7.5; 100", ".87 .70 .52", "1.02; 4.8", "1.08"),
    "braking 20, 0.9 (matched)": (".386/.49/62", "1.3, 3.5, 7.27; 100", ".84 .68 .50", ".93; 6.9", "1.06"),
}


@pytest.mark.parametrize("row", saturation.ROWS, ids=lambda row: row.name)
def test_a_design_does_what_is_known_of_it(row: saturation.Row) -> None:
    _, *found = saturation.cells(row)
    assert len(found) == len(KNOWN[row.name])
    for cell, known in zip(found, KNOWN[row.name], strict=True):
        values, wanted = (re.findall(r"[\d.]+|lost", text) for text in (cell, known))
        assert len(values) == len(wanted)
        for value, text in zip(values, wanted, strict=True):
            assert agrees(value, text), (cell, known)


def agrees(value: str, known: str) -> bool:
    """Whether a number is another one to its last digit; both are rounded."""
    if "lost" in (value, known):
        return value == known
    digit = Decimal(known).as_tuple().exponent
    assert isinstance(digit, int)
    own = Decimal(value).as_tuple().exponent
    assert isinstance(own, int)
    slack = (Decimal(1).scaleb(digit) + Decimal(1).scaleb(own)) / 2
    return abs(Decimal(value) - Decimal(known)) <= slack


def test_the_comparison_can_fail() -> None:
    assert agrees("0.4176", ".418") and not agrees("0.4165", ".418")
    assert not agrees("lost", "6.8")
