"""What docs/gallery.md says does not fit is refused, with the term that blocks it, if a file has it."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from typing import Any

import pytest

from docs import gallery
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of

Document = dict[str, Any]


def measured_hub(document: Document) -> None:
    document["system"]["output"] = "hub"


def measured_hub_without_gravity(document: Document) -> None:
    measured_hub(document)
    document["parameters"]["g"]["value"] = 0.0
    document["system"]["rates"][1] = "K_s*(hub - link)/J_l"


def coil_with_its_voltage(document: Document) -> None:
    document["system"] |= {
        "states": ["gap", "speed", "i"],
        "rates": ["speed", "g - K_m*i**2/(2*m*gap**2)", "(u - 11*i)/0.4125"],
        "units": ["m", "m/s", "A"],
    }
    document["simulation"]["x0"] = [0.0065, 0.0, 0.9]


def sensor_of_the_heater(document: Document) -> None:
    (rate,) = document["system"]["rates"]
    document["system"] |= {
        "states": ["T_s", "T"],
        "rates": ["(T - T_s)/20", rate],
        "output": "T_s",
        "units": ["K", "K"],
    }
    document["simulation"]["x0"] *= 2


def degrees_celsius(document: Document) -> None:
    document["parameters"]["T_a"] |= {"value": 23.0, "unit": "degC"}


def integrator(document: Document) -> None:
    system = document["system"]
    system["states"] = ["sum", *system["states"]]
    system["rates"] = [system["output"], *system["rates"]]
    system["disturbance"] = ["0", *system["disturbance"]]
    system["units"] = ["m s", *system["units"]]
    document["simulation"]["x0"] = [0.0, *document["simulation"]["x0"]]


def sine_of_the_angle(document: Document) -> None:
    document["system"]["rates"][1] = "5/7*g*r_arm/l*sin(angle)"


def centrifugal_term(document: Document) -> None:
    document["system"]["rates"][1] += " + 5/7*(r_arm/l)**2*ball*spin**2"


def dead_time(document: Document) -> None:
    document["system"]["transfer_function"]["delay"] = 1.0


@pytest.mark.parametrize(
    ("name", "change", "reason"),
    [
        ("flexible-joint", measured_hub, r"sin\(link\).* is not linear in link, which is not measured"),
        ("flexible-joint", measured_hub_without_gravity, r"roots 0-16\.5\d*j, 0\+16\.5\d*j"),
        ("maglev", coil_with_its_voltage, r"i\*\*2.* is not linear in i, which is not measured"),
        ("mariner", dead_time, r"a dead time is not part of the design"),
        ("hydraulic", integrator, r"sum cannot be told from the output pos"),
        ("tclab", sensor_of_the_heater, r"T\*\*4.* is not linear in T, which is not measured"),
        ("tclab", degrees_celsius, r"has an offset"),
        ("ball-and-beam", sine_of_the_angle, r"sin\(angle\).* is not linear in angle, which is not measured"),
        ("ball-and-beam", centrifugal_term, r"spin\*\*2.* is not linear in spin, which is not measured"),
    ],
)
def test_what_does_not_fit_is_refused(name: str, change: Callable[[Document], None], reason: str) -> None:
    file = next(system.file for system in gallery.systems() if system.model == name)
    document = tomllib.loads(file.read_text(encoding="utf-8"))
    model_of(document, name)  # as it stands, it fits
    document = tomllib.loads(file.read_text(encoding="utf-8"))
    change(document)
    with pytest.raises(ModelError, match=reason):
        model_of(document, name)
