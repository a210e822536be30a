"""Turns pydantic's errors into the one line that a user needs."""

from __future__ import annotations

from collections.abc import Sequence
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from pmjoint_codegen.errors import ModelError, did_you_mean, quoted
from pmjoint_codegen.modelfile.names import key_path


def first_complaint(error: ValidationError, schema: type[BaseModel], where: str) -> ModelError:
    """Turn a validation error into one line; an unknown key first: a misspelt key is also a missing one."""
    found = error.errors(include_url=False)
    worst = min(found, key=lambda detail: detail["type"] != "extra_forbidden")
    path = _document_path(worst["loc"])
    what, allowed = _what(worst), _allowed(worst, path, schema)
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return ModelError(f"{what}{more}", where=f"{where}: {key_path(path)}", remedy=allowed)


def _document_path(loc: tuple[int | str, ...]) -> tuple[int | str, ...]:
    """Drop pydantic's additions to a place, such as the member of a union that it tried."""
    return tuple(
        part
        for part in loc
        if isinstance(part, int) or not part.startswith(("tuple[", "function-", "nullable"))
    )


def _what(detail: ErrorDetails) -> str:
    if detail["type"] == "extra_forbidden":
        return "unknown key"
    if detail["type"] == "missing":
        return "is missing"
    value = detail["input"]
    if detail["type"] == "string_too_long":
        return f"has {len(value)} characters"
    if detail["type"] in ("too_long", "too_short"):
        return f"has {len(value)} entries"
    return f"is {_shown(value)}"


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, tuple):
        return f"a list of {len(value)}" if value else "an empty list"
    return f"the text {quoted(value)}" if isinstance(value, str) else quoted(value)


def _allowed(detail: ErrorDetails, path: Sequence[int | str], schema: type[BaseModel]) -> str:
    if detail["type"] == "extra_forbidden":
        table, _ = _schema_at(path[:-1], schema)
        return _known_keys(str(path[-1]), list(_fields(table)))
    _, field = _schema_at(path, schema)
    return f"allowed: {field.description}" if field and field.description else ""


def _known_keys(asked: str, keys: list[str]) -> str:
    return f"{did_you_mean(asked, keys)}allowed: {', '.join(keys)}"


def _schema_at(path: Sequence[int | str], schema: type[BaseModel]) -> tuple[Any, FieldInfo | None]:
    """Follow a path into the schema: the type that stands there, and the innermost field on the way."""
    here: Any = schema
    field: FieldInfo | None = None
    for part in path:
        if get_origin(here) is dict:
            here = get_args(here)[1]
        elif isinstance(part, str) and part in (fields := _fields(here)):
            field = fields[part]
            here = _inner(field.annotation)
    return here, field


def _inner(annotation: Any) -> Any:
    """The table in an annotation: what is left when None, and what `Annotated` adds, are taken away."""
    if get_origin(annotation) in (Union, UnionType):
        kinds = [_inner(kind) for kind in get_args(annotation) if kind is not type(None)]
        return next((kind for kind in kinds if _fields(kind)), kinds[0])  # a line rather than a text
    return _inner(get_args(annotation)[0]) if get_origin(annotation) is Annotated else annotation


def _fields(table: Any) -> dict[str, FieldInfo]:
    """Fields of a table by the key that stands in the file; none where `table` is a plain type."""
    if not (isinstance(table, type) and issubclass(table, BaseModel)):
        return {}
    return {field.alias or name: field for name, field in table.model_fields.items()}
