"""The mathematics: a model in, named equations out. SymPy only; reads and writes no file."""

from pmjoint_derive.derivation import derive
from pmjoint_derive.design import Derivation, Design
from pmjoint_derive.equation import Equation, Equations, real_symbol
from pmjoint_derive.model import Gains, Model, OutsideClassError, Parameter, Plant, Simulation
from pmjoint_derive.signals import Signals

__all__ = [
    "Derivation",
    "Design",
    "Equation",
    "Equations",
    "Gains",
    "Model",
    "OutsideClassError",
    "Parameter",
    "Plant",
    "Signals",
    "Simulation",
    "derive",
    "real_symbol",
]
