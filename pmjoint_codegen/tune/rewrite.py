"""A model file with other gains and another name; every other character stays, comments too.

Where a gain is replaced, the line's comment is kept after the former value, which it may describe:
``k = [31.2, 977] # was [40, 400]: both poles of A0 at -20``. The result is parsed again: it
is the model with these gains, or there is no result.
"""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, Final

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.values import GAINS

_ARRAY: Final = r"^([ \t]*{key}[ \t]*=[ \t]*)(\[[^\]]*\])[ \t]*(#[^\r\n]*)?"
_POLES: Final = r"^([ \t]*{key}[ \t]*=[ \t]*)(\[(?:[^\[\]]|\[[^\]]*\])*\]|[^\s#]+)[ \t]*(#[^\r\n]*)?"
_NAME: Final = re.compile(r"^(name[ \t]*=[ \t]*)(\"[^\"\r\n]*\"|'[^'\r\n]*')", re.MULTILINE)
_TABLE: Final = re.compile(r"^[ \t]*\[(?![ \t\r\n]*[\"'\d])", re.MULTILINE)
_DESIGN: Final = re.compile(r"^[ \t]*\[[ \t]*design[ \t]*\][^\r\n]*", re.MULTILINE)


def rewrite(
    text: str,
    name: str,
    gains: Mapping[str, float],
    note: str,
    where: str,
    own: Mapping[str, float] | None = None,
) -> str:
    """Put gains and a name into a model file's text.

    Args:
        text: of the file.
        name: of the new model.
        gains: name -> value, such as ``c1``; other gains stay.
        note: one line for the comment at the head.
        where: file at the start of a message.
        own: every gain of the model, for lists of which the file gives none: they follow from other keys.

    Raises:
        ModelError: the file is written in a way that cannot be edited in place.
    """
    document = tomllib.loads(text)
    wanted = _changed(document, name, gains, own or {})
    edited = _NAME.sub(lambda match: f'{match[1]}"{name}"', text, count=1)
    heading = _DESIGN.search(edited)
    if heading is not None:
        following = _TABLE.search(edited, heading.end())
        end = following.start() if following else len(edited)
        section = edited[heading.end() : end]
        for kind in (item.name for item in GAINS):
            if wanted["design"].get(kind) != document["design"].get(kind):
                section = _replaced(section, _key_of(kind, document), kind, wanted["design"][kind])
        edited = edited[: heading.end()] + section + edited[end:]
    newline = "\r\n" if "\r\n" in text else "\n"
    edited = f"# {' '.join(note.split())}{newline}{edited}"
    if not _says(edited, wanted):
        raise ModelError(
            "cannot be edited in place",
            where=where,
            remedy='write name = "..." at the top, and c, e, ck, k each as a list under [design]',
        )
    return edited


def _changed(
    document: Mapping[str, Any], name: str, gains: Mapping[str, float], own: Mapping[str, float]
) -> dict[str, Any]:
    changed = copy.deepcopy(dict(document))
    changed["name"] = name
    for gain, value in gains.items():
        kind = gain.rstrip("0123456789")
        if kind not in changed["design"]:
            changed["design"][kind] = [own[item] for item in own if re.fullmatch(f"{kind}[1-9]", item)]
        changed["design"][kind][int(gain[len(kind) :]) - 1] = value
    if "k" in changed["design"]:
        changed["design"].pop("poles", None)
    return changed


def _key_of(kind: str, document: Mapping[str, Any]) -> str | None:
    """The key whose line gives a list of gains now: poles may stand for k; None if there is none."""
    keys = (kind, "poles") if kind == "k" else (kind,)
    return next((key for key in keys if key in document["design"]), None)


def _replaced(section: str, old: str | None, key: str, values: Sequence[float]) -> str:
    if old is None:
        return f"\n{key} = [{', '.join(map(_decimal, values))}]{section}"

    def line(match: re.Match[str]) -> str:
        former = re.sub(r"\s+", " ", re.sub(r"#[^\r\n]*", "", match[2]))
        about = f": {match[3].lstrip('# ')}" if match[3] else ""
        head = match[1] if old == key else "k = "
        was = former if old == key else f"{old} = {former}"
        return f"{head}[{', '.join(map(_decimal, values))}] # was {was}{about}"

    pattern = re.compile((_ARRAY if old == key else _POLES).format(key=old), re.MULTILINE)
    return pattern.sub(line, section, count=1)


def _decimal(value: float) -> str:
    """A number as TOML: the shortest that round-trips."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _says(text: str, wanted: Mapping[str, Any]) -> bool:
    try:
        return tomllib.loads(text) == wanted
    except tomllib.TOMLDecodeError:
        return False
