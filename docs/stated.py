"""Numbers that the documentation's prose states, each computed: ``<!-- NAME -->TEXT<!-- / -->``.

`make docs` fills them in; a test computes them again and compares. A name that nobody computes is refused.
"""

from __future__ import annotations

import json
import re
import shlex
import tempfile
from collections.abc import Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from docs import adaptive
from docs.saturation import STRIP, table
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.storage import write_text
from pmjoint_codegen.sweep.plan import CODES
from pmjoint_codegen.sweep.region import border, held

DOCS = Path(__file__).resolve().parent
PAGES = ("adaptive.md", "saturation.md", "sweep.md", "tune.md")
MARK = re.compile(r"(<!-- ([a-z]\w*(?:\.\w+)+) -->)(.*?)(<!-- / -->)", re.DOTALL)

REGION = "sweep paper --grid x1=-100:100:401 --grid x2=-40:40:161 --grid compensator=0,1"
SATURATION = (
    "sweep paper --start matched --set ck1=12 --set ck2=12 --reference 0 --disturbance 0 --disturbance 0 "
    "--horizon 60 --grid x1=-100:100:101 --grid x2=-40:40:41 --grid saturation=compensator,clip,braking"
)
TUNED = re.compile(r"^\| `pmjoint (tune [^`]*)`.*?<!-- tune\.(\w+)_before -->", re.MULTILINE)
MISMATCH = 'sweep joint-damped --sample "{name}~uniform(0.035,0.065)" --runs 10000 --seed 7'


def stated(text: str) -> dict[str, str]:
    """Every marked number of a page, by name."""
    return {match[2]: match[3] for match in MARK.finditer(text)}


def filled(text: str, values: Mapping[str, str]) -> str:
    """A page with its marked numbers as computed.

    Raises:
        KeyError: a name that is not computed.
    """
    return MARK.sub(lambda match: f"{match[1]}{values[match[2]]}{match[4]}", text)


def computed() -> dict[str, str]:
    """Every number by name, as the prose writes it: some 300 000 runs, in half a minute."""
    return {
        **adaptive.stated(),
        **_region(),
        **_saturation(),
        **_mismatch("J_plant"),
        **_mismatch("J"),
        **_tuned(),
    }


def _dataset(command: str) -> xr.Dataset:
    """The dataset of a sweep, in memory."""
    with tempfile.TemporaryDirectory() as folder:
        with redirect_stdout(StringIO()):
            code = run([*shlex.split(command), "--no-figures", "--out", folder])
        if code:
            raise SystemExit(f"docs: pmjoint {command} failed")
        data: xr.Dataset = xr.open_zarr(Path(folder) / "sweep.zarr", consolidated=False).load()
    return data


def _region() -> dict[str, str]:
    """Shares of the states between the borders that are held, in all and where |x2| is small."""
    data = _dataset(REGION)
    manifest = Manifest.read(DOCS.parent / "generated" / "paper")
    line = border(manifest, {item.name: item.value for item in manifest.parameters})
    assert line is not None  # the paper's plant has d1 > 0
    between = np.abs(data.x1 + data.x2 / line.slope) <= line.offset
    slow = between & (np.abs(data.x2) <= 20.0)
    found = {}
    for name, switch in (("compensator", 1), ("clip", 0)):
        kept = held(data).sel(compensator=switch)
        for region, where in (("held", between), ("slow", slow)):
            found[f"region.{region}_{name}"] = f"{100 * float((kept & where).sum() / where.sum()):.4g} %"
    return found


def _saturation() -> dict[str, str]:
    """The table of designs, and the shares of the states in the strip that each kind of saturation holds."""
    data = _dataset(SATURATION)
    parameters = json.loads(data.attrs["parameters"])
    inside = np.abs(data.x1 + data.x2 / np.sqrt(parameters["d1"])) < STRIP
    found = {"saturation.table": f"\n{table()}\n"}
    for name, code in CODES.items():
        kept = held(data).sel(saturation=code)
        found[f"saturation.{name}"] = f"{100 * float((kept & inside).sum() / inside.sum()):.3g} %"
    return found


def _mismatch(name: str) -> dict[str, str]:
    """Fifth and ninety-fifth percentile of the integral of e^2."""
    ends = np.percentile(_dataset(MISMATCH.format(name=name))["ise"].values, [5.0, 95.0])
    low, high = (f"{end:.3e}".replace("e-0", "e-") for end in ends.tolist())
    return {f"mismatch.{name}_low": low, f"mismatch.{name}_high": high}


def _tuned() -> dict[str, str]:
    """Objective and largest |v| before and after each search that docs/tune.md lists, worst plant."""
    found = {}
    for command, name in TUNED.findall((DOCS / "tune.md").read_text(encoding="utf-8")):
        comparison = _comparison(command)
        values = comparison.get("worst", comparison["nominal"])
        for prefix, quantity in (("", "objective"), ("v_", "max_abs_v")):
            for when, value in values[quantity].items():
                found[f"tune.{name}_{prefix}{when}"] = f"{value:#.4g}".replace("e-0", "e-")
    return found


def _comparison(command: str) -> dict[str, Any]:
    """What a search prints as JSON."""
    printed = StringIO()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(printed):
        code = run([*shlex.split(command), "--no-figure", "--json", "--out", f"{folder}/tuned.toml"])
    if code:
        raise SystemExit(f"docs: pmjoint {command} failed")
    comparison: dict[str, Any] = json.loads(printed.getvalue())
    return comparison


def fill() -> None:
    """Write the numbers into the pages."""
    values = computed()
    for page in PAGES:
        path = DOCS / page
        write_text(path, filled(path.read_text(encoding="utf-8"), values))
