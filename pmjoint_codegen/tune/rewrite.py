"""A model file with other gains and another name; every other character stays, comments too.

Where a search was told of another start or saturation, these keys of the design change with the gains: gains
found for one compensator mean nothing for another.

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
from pmjoint_codegen.values import BRAKING, COMPENSATOR, GAINS, OBSERVER

_ARRAY: Final = r"^([ \t]*{key}[ \t]*=[ \t]*)(\[[^\]]*\])[ \t]*(#[^\r\n]*)?"
_POLES: Final = r"^([ \t]*{key}[ \t]*=[ \t]*)(\[(?:[^\[\]]|\[[^\]]*\])*\]|[^\s#]+)[ \t]*(#[^\r\n]*)?"
_SCALAR: Final = r"^[ \t]*{key}[ \t]*=[ \t]*([^\s#]+)[ \t]*(#[^\r\n]*)?"
_NAME: Final = re.compile(r"^(name[ \t]*=[ \t]*)(\"[^\"\r\n]*\"|'[^'\r\n]*')", re.MULTILINE)
_TITLE: Final = re.compile(r"^(title[ \t]*=[ \t]*\")([^\"\\\r\n]{1,380})\"", re.MULTILINE)
_TUNED: Final = ", gains tuned"  # in a title: figures must not credit a source with gains that it has not
_TABLE: Final = re.compile(r"^[ \t]*\[(?![ \t\r\n]*[\"'\d])", re.MULTILINE)
_SATURATION: Final = "saturation"
_DESIGN: Final = re.compile(r"^[ \t]*\[[ \t]*design[ \t]*\][^\r\n]*", re.MULTILINE)


def rewrite(
    text: str,
    name: str,
    gains: Mapping[str, float],
    note: str,
    where: str,
    own: Mapping[str, float] | None = None,
    words: Mapping[str, str] | None = None,
) -> str:
    """Put gains and a name into a model file's text.

    Args:
        text: of the file.
        name: of the new model.
        gains: name -> value, such as ``c1``; other gains stay.
        note: one line for the comment at the head.
        where: file at the start of a message.
        own: every gain of the model, for lists of which the file gives none: they follow from other keys.
        words: ``start`` and ``saturation``, where they are not to stay as they are.

    Raises:
        ModelError: the file is written in a way that cannot be edited in place.
    """
    document = tomllib.loads(text)
    wanted = _changed(document, name, gains, own or {}, words or {})
    edited = _NAME.sub(lambda match: f'{match[1]}"{name}"', text, count=1)
    title = _TITLE.search(edited)
    if title is not None and title[2] == document.get("title") and not title[2].endswith(_TUNED):
        wanted["title"] = title[2] + _TUNED
        edited = _TITLE.sub(lambda match: f'{match[1]}{match[2]}{_TUNED}"', edited, count=1)
    heading = _DESIGN.search(edited)
    if heading is not None:
        following = _TABLE.search(edited, heading.end())
        end = following.start() if following else len(edited)
        section = _redesigned(edited[heading.end() : end], document["design"], wanted["design"])
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


def _redesigned(section: str, present: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    """The lines of [design] with other gains and words."""
    for kind in (item.name for item in GAINS):
        if wanted.get(kind) != present.get(kind):
            section = _replaced(section, _key_of(kind, present), kind, wanted[kind])
    if wanted.get(OBSERVER) != present.get(OBSERVER):
        section = _worded(section, OBSERVER, OBSERVER, _decimal(wanted[OBSERVER]))
    for key in ("start", _SATURATION):
        if wanted.get(key) != present.get(key):
            section = _worded(section, _word_of(key, present), key, f'"{wanted[key]}"')
    for key in (COMPENSATOR, BRAKING):
        if key in present and key not in wanted:
            pattern = re.compile(_SCALAR.format(key=key), re.MULTILINE)
            section = pattern.sub(rf"# was {key} = \1", section, count=1)
    return section


def _changed(
    document: Mapping[str, Any],
    name: str,
    gains: Mapping[str, float],
    own: Mapping[str, float],
    words: Mapping[str, str],
) -> dict[str, Any]:
    changed = copy.deepcopy(dict(document))
    changed["name"] = name
    changed["design"].update(words)
    if _SATURATION in words:
        changed["design"].pop(COMPENSATOR, None)
        if words[_SATURATION] != BRAKING:
            changed["design"].pop(BRAKING, None)
    for gain, value in gains.items():
        if gain == OBSERVER:  # one number, not a list
            changed["design"][gain] = value
            continue
        kind = gain.rstrip("0123456789")
        if kind not in changed["design"]:
            changed["design"][kind] = [own[item] for item in own if re.fullmatch(f"{kind}[1-9]", item)]
        changed["design"][kind][int(gain[len(kind) :]) - 1] = value
    if "k" in changed["design"]:
        changed["design"].pop("poles", None)
    return changed


def _key_of(kind: str, design: Mapping[str, Any]) -> str | None:
    """The key whose line gives a list of gains now: poles may stand for k; None if there is none."""
    keys = (kind, "poles") if kind == "k" else (kind,)
    return next((key for key in keys if key in design), None)


def _word_of(key: str, design: Mapping[str, Any]) -> str | None:
    """The key whose line says this now: the compensator's switch may stand for saturation."""
    keys = (key, COMPENSATOR) if key == _SATURATION else (key,)
    return next((item for item in keys if item in design), None)


def _worded(section: str, old: str | None, key: str, word: str) -> str:
    """The section with ``key = word`` in place of a line, or as its first line; word as TOML has it."""
    if old is None:
        return f"\n{key} = {word}{section}"

    def line(match: re.Match[str]) -> str:
        about = f": {match[2].lstrip('# ')}" if match[2] else ""
        return f"{key} = {word} # was {old} = {match[1]}{about}"

    return re.sub(_SCALAR.format(key=old), line, section, count=1, flags=re.MULTILINE)


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
