"""The page: one HTML file with styles, scripts, equations and the compiled loop inside."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pmjoint_codegen import __version__
from pmjoint_codegen.compile.zig import zig_compiler
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.explorer.facts import facts_of
from pmjoint_codegen.explorer.knobs import Knobbed, with_knobs
from pmjoint_codegen.explorer.module import build_module
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.provision import Notify, Provided, Stage, provide_document
from pmjoint_codegen.simulate.blocks import compensator_states
from pmjoint_codegen.simulate.estimates import is_adaptive
from pmjoint_codegen.values import BRAKING, CLIP, COMPENSATOR, obeys
from pmjoint_codegen.workspace import cache_dir, find_model

WEB: Final = Path(__file__).parent / "web"
SCRIPTS: Final = (
    "numbers.js",
    "actuator.js",
    "engine.js",
    "settings.js",
    "plot.js",
    "panels.js",
    "words.js",
    "law.js",
    "controls.js",
    "page.js",
)
BRAKING_ORDER: Final = 2  # relative degree for which there is a braking compensator


@dataclass(frozen=True)
class Page:
    """A finished page.

    Attributes:
        html: its text.
        saturations: what it offers about a saturated input.
        knobs: names of the parameters that it adds to the model.
        bytes: length of each module, by saturation.
    """

    html: str
    saturations: tuple[str, ...]
    knobs: tuple[str, ...]
    bytes: Mapping[str, int]


@dataclass(frozen=True)
class Prepared:
    """A model with knobs, and its kernels for each compensator.

    Attributes:
        name: how the model is called on a command line.
        reference: the model's own, in one line.
        knobbed: the model.
        variants: saturation -> kernels; ``clip`` is a switch of each.
    """

    name: str
    reference: str
    knobbed: Knobbed
    variants: Mapping[str, Provided]

    @property
    def title(self) -> str:
        """The model's own name."""
        return next(iter(self.variants.values())).manifest.name


def prepare(
    model: str | Path,
    *,
    environment: Mapping[str, str],
    notify: Notify,
    stage: Stage = lambda name, done: None,
) -> Prepared:
    """Derive a model with knobs, for every compensator that it can have.

    Args:
        model: name or path.
        environment: for the cache folder.
        notify: called with one line about a compensator that is left out.
        stage: called with the stage of a derivation.

    Raises:
        ModelError: the model cannot be found, read or derived.
        MissingToolError: the toolchain is not installed.
    """
    path = find_model(model)
    document = read_document(path)

    def provide(contents: Mapping[str, Any], saturation: str | None = None) -> Provided:
        return provide_document(
            path,
            contents,
            saturation=saturation,
            environment=environment,
            notify=lambda line: None,
            stage=stage,
        )

    base = provide(document).manifest
    if not compensator_states(base):
        raise ModelError(
            "the page is made for laws with a compensator, and this one has none",
            where=f"model {base.name}: design.law",
            remedy='give law = "backstepping"',
        )
    knobbed = with_knobs(document, base)
    own = BRAKING if any(item.name == BRAKING for item in base.settable) else COMPENSATOR
    variants = {own: provide(knobbed.document)}
    other = COMPENSATOR if own == BRAKING else BRAKING
    if base.rho == BRAKING_ORDER and not is_adaptive(base):
        try:
            variants[other] = provide(knobbed.document, other)
        except ModelError as error:
            notify(f"the page leaves out {other}: {error}")
    return Prepared(str(model), base.simulation.reference_text, knobbed, variants)


def make_page(
    prepared: Prepared,
    *,
    environment: Mapping[str, str],
    notify: Callable[[str], None],
    stage: Stage = lambda name, done: None,
) -> Page:
    """Compile the kernels of a prepared model and put the page together.

    Args:
        prepared: by `prepare`.
        environment: for the cache folder.
        notify: called with one line for the user.
        stage: called with the name of a slow stage.

    Raises:
        MissingToolError: ziglang is not installed.
        BuildError: it failed.
    """
    zig, cache = zig_compiler(environment), cache_dir(environment, notify)
    variants, sizes = {}, {}
    for saturation, provided in prepared.variants.items():
        stage(f"compiling the loop with {saturation} for the browser", 0.0)
        module = build_module(provided, zig, cache)
        sizes[saturation] = len(module)
        encoded = base64.b64encode(module).decode("ascii")
        variants[saturation] = {**facts_of(provided.manifest, provided.folder), "wasm": encoded}
    manifest = next(iter(prepared.variants.values())).manifest
    data = {
        "name": manifest.name,
        "called": prepared.name,
        "version": __version__,
        "knobs": [vars(knob) for knob in prepared.knobbed.knobs],
        "reference": prepared.reference,
        "patterns": {key: list(value) for key, value in prepared.knobbed.patterns.items()},
        "variants": variants,
    }
    return Page(
        html=_filled(manifest, data),
        saturations=(*variants, *((CLIP,) if _clips(manifest) else ())),
        knobs=tuple(knob.name for knob in prepared.knobbed.knobs),
        bytes=sizes,
    )


def _clips(manifest: Manifest) -> bool:
    """Whether the model allows plain clipping: no rule about the compensator's switch refuses it."""
    off = {COMPENSATOR: np.zeros(1)}
    return all(obeys(rule, off)[0] for rule in manifest.rules if rule.names == {COMPENSATOR})


def _filled(manifest: Manifest, data: Mapping[str, Any]) -> str:
    """The template with its words replaced, each once: what is put in is not searched."""
    words = {
        "title": _escaped(manifest.title),
        "name": _escaped(manifest.name),
        "source": _escaped(manifest.source),
        "version": __version__,
        "style": (WEB / "style.css").read_text(encoding="utf-8"),
        # `<` could end the element; JSON reads it back from its escape.
        "data": json.dumps(data, ensure_ascii=True, allow_nan=False).replace("<", "\\u003c"),
        "script": "\n".join((WEB / name).read_text(encoding="utf-8") for name in SCRIPTS),
    }
    parts = re.split(f"@({'|'.join(words)})@", (WEB / "page.html.in").read_text(encoding="utf-8"))
    return "".join(words[part] if i % 2 else part for i, part in enumerate(parts))


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")
