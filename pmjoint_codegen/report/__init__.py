"""A derivation for people: as text that copies into code, as LaTeX, as one JSON document."""
