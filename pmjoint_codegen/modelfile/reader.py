"""A model file as nested dictionaries, or one line that states why it cannot be read."""

from __future__ import annotations

import datetime
import os
import tomllib
from pathlib import Path
from typing import Any

from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.modelfile.names import key_path

# Far above any honest model file, to bound the time of a hostile one: a dotted key costs its length squared.
_MOST_BYTES = 64 * 1024
_LONGEST_LINE = 4096
_DEEPEST = 8
_INTEGERS = 2**63


def read_document(path: Path) -> dict[str, Any]:
    """Read a model file.

    Args:
        path: a regular TOML file in UTF-8.

    Raises:
        ModelError: the file is missing, unreadable, not UTF-8, not TOML (with the line), or far too large.
    """
    where = str(path)
    return parse_document(_decode(_read(path, where), where), where)


def parse_document(text: str, where: str) -> dict[str, Any]:
    """Parse a model file's text; `where` begins every message. Raises `ModelError` as `read_document`."""
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > _LONGEST_LINE:
            raise ModelError(
                f"line {number} has {len(line)} characters",
                where=where,
                remedy=f"allowed: {_LONGEST_LINE} a line",
            )
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ModelError(f"is not valid TOML: {error}", where=where, remedy="see https://toml.io") from error
    except (
        ValueError,
        RecursionError,
    ) as error:  # impossible dates, numbers too long to convert, bottomless nesting
        raise ModelError(f"is not valid TOML: {error}", where=where, remedy="see https://toml.io") from error
    _check_contents(document, where)
    return document


def _read(path: Path, where: str) -> bytes:
    """Read at most a little more than the limit: a pipe or device might never end."""
    if not os.path.exists(path):
        raise ModelError("no such model file", where=where, remedy="give the path of a .toml file")
    if os.path.isdir(path):
        raise ModelError("is a folder, not a model file", where=where, remedy="give the path of a .toml file")
    try:
        with path.open("rb") as stream:
            data = stream.read(_MOST_BYTES + 1)
    except OSError as error:
        raise ModelError(f"cannot be read ({error.strerror})", where=where) from error
    if len(data) > _MOST_BYTES:
        raise ModelError("is too large for a model file", where=where, remedy=f"allowed: {_MOST_BYTES} bytes")
    return data


def _decode(data: bytes, where: str) -> str:
    try:
        return data.decode("utf-8-sig")  # some editors begin a file with a byte-order mark
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ModelError(
            f"is not UTF-8: byte 0x{data[error.start]:02x} on line {line}",
            where=where,
            remedy="save the file as UTF-8",
        ) from error


def _check_contents(document: dict[str, Any], where: str) -> None:
    """Refuse what the canonical form of a model cannot represent: deep nesting, huge integers, dates.

    Level by level, not recursively: a dotted key nests deeper than Python recurses.
    """
    level: list[tuple[tuple[int | str, ...], Any]] = [((), document)]
    for _ in range(_DEEPEST):
        level = [inner for path, item in level for inner in _members(path, item)]
        for path, item in level:
            place = f"{where}: {key_path(path)}"
            if isinstance(item, int) and abs(item) >= _INTEGERS:
                raise ModelError(
                    f"is {quoted(item)}", where=place, remedy="allowed: 64-bit integers and decimals"
                )
            if isinstance(item, datetime.date | datetime.time):
                raise ModelError(
                    "is a date or time", where=place, remedy="allowed: text, numbers, lists, tables"
                )
    if level:
        raise ModelError(
            "is nested too deeply for a model file", where=where, remedy=f"allowed: {_DEEPEST} levels"
        )


def _members(path: tuple[int | str, ...], item: Any) -> list[tuple[tuple[int | str, ...], Any]]:
    if isinstance(item, dict):
        return [((*path, key), inner) for key, inner in item.items()]
    return [((*path, i), inner) for i, inner in enumerate(item)] if isinstance(item, list) else []
