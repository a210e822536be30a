"""Model files: read, validated, and turned into what the derivation takes.

    reader       path -> document          TOML as nested dictionaries; needs the standard library only
    schema       document -> ModelSpec     every key with its type and what is allowed there (pydantic)
    complaints   what pydantic found -> one line that names file, key, what is wrong and what is allowed
    names        which names a parameter may bear
    expressions  text -> SymPy             a whitelist; nothing in a model file is ever executed
    bounds       how large a power SymPy may be asked for
    points       the value of an expression at one point, in bounded time
    zeros        whether sigma vanishes in the stated range, by interval arithmetic
    soundness    what the plant class demands of a model's numbers
    model        ModelSpec -> pmjoint_derive.Model the driver: parse, check, hand over

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
        document: what `reader.read_document` gave, possibly with a key replaced.
        where: file that a message begins with.

    Raises:
        ModelError: for anything that is wrong with it.
    """
    from pmjoint_codegen.modelfile.model import to_derive
    from pmjoint_codegen.modelfile.schema import validate

    return to_derive(validate(document, where), where)
