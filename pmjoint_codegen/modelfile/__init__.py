"""Model files: read, validated, and turned into the input of the derivation.

    reader       path -> document          TOML as nested dictionaries; needs the standard library only
    schema       document -> ModelSpec     every key with its type and allowed values (pydantic)
    complaints   pydantic's errors -> one line that names file, key, error and allowed values
    system       [system]: its keys, and what it refuses
    load         a constant load as one more column of Phi
    entries      entries of b and theta by the names of [adaptation]
    stated       what [adaptation] says of each entry, and the numbers that follow
    reserved     names that a design with estimates gives to numbers and signals of its own
    estimates    [adaptation] -> what the controller does not know
    names        allowed names of parameters
    expressions  text -> SymPy             a whitelist; nothing in a model file is ever executed
    bounds       limits on powers before SymPy computes them
    points       the value of an expression at one point, in bounded time
    zeros        whether sigma vanishes in the stated range, by interval arithmetic
    soundness    conditions of the plant class on a model's numbers
    model        ModelSpec -> pmjoint_derive.Model the driver: parse, check, convert

Importing this package imports none of them: the reader must stay usable without SymPy and pydantic.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pmjoint_derive import Model

__all__ = ["model_of"]


def model_of(document: Mapping[str, Any], where: str) -> Model:
    """Turn a model file's document into the record that the derivation takes.

    Args:
        document: from `reader.read_document`, possibly with a key replaced.
        where: file at the start of a message.

    Raises:
        ModelError: for anything that is wrong with it.
    """
    from pmjoint_codegen.modelfile.model import to_derive
    from pmjoint_codegen.modelfile.schema import validate

    return to_derive(validate(document, where), where)
