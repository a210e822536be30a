"""Packages that can be called by their own name, as in `pmjoint_codegen.sweep(...)`.

A package binds its subpackages to its own attributes whenever one is imported, so a function of the same name
would be replaced at some moment. A subpackage that can be called is the same object at all times.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any


class CallablePackage(ModuleType):
    """A package whose call is that of a function of the same name, imported at the first call."""

    @property
    def __wrapped__(self) -> Any:
        """The function, which `inspect.signature` and `help` look for here."""
        home = import_module(f"{__package__}.studies.{self.__name__.rpartition('.')[2]}")
        return vars(home)[self.__name__.rpartition(".")[2]]

    def __call__(self, *args: Any, **keywords: Any) -> Any:
        """Call the function."""
        return self.__wrapped__(*args, **keywords)


def make_callable(package: str) -> None:
    """Let a package that is being imported be called; the function stands in `studies`, under its name."""
    sys.modules[package].__class__ = CallablePackage
