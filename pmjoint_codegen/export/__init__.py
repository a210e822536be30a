"""A model's controller as C that stands alone: readable, without CasADi and without this package."""
