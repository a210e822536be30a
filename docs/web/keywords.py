"""Show the keys of ``**asked: Unpack[Options]`` as parameters of the function, with their types.

griffe has an extension for this. It repeats the parameters of the docstring and passes over inherited keys.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from griffe import (
    Class,
    Expr,
    ExprSubscript,
    Extension,
    Function,
    Module,
    Parameter,
    ParameterKind,
    Parameters,
)


class Keywords(Extension):
    """What mkdocs.yml names."""

    def on_package(self, *, pkg: Module, **kwargs: Any) -> None:
        """Spread the keywords of each function of a package that has been read."""
        for function in functions(pkg):
            spread(function)


def functions(home: Module | Class) -> Iterator[Function]:
    """Yield the functions of a module and of all inside it."""
    for member in home.members.values():
        if isinstance(member, Function):
            yield member
        elif isinstance(member, Module | Class):
            yield from functions(member)


def spread(function: Function) -> None:
    """Put the keys in the place of the parameter that takes them."""
    found: list[Parameter] = []
    for parameter in function.parameters:
        options = _options(function, parameter)
        found += [parameter] if options is None else options
    function.parameters = Parameters(*found)


def _options(function: Function, parameter: Parameter) -> list[Parameter] | None:
    annotation = parameter.annotation
    if parameter.kind is not ParameterKind.var_keyword or not isinstance(annotation, ExprSubscript):
        return None
    if function.docstring and f" {parameter.name}: " in function.docstring.value:
        return None  # it is documented as one
    if str(annotation.left) != "Unpack" or not isinstance(annotation.slice, Expr):
        return None
    keys = function.modules_collection[annotation.slice.canonical_path]
    return [
        Parameter(field.name, annotation=field.annotation, kind=ParameterKind.keyword_only, default="...")
        for field in keys.attributes.values()  # inherited ones first
    ]
