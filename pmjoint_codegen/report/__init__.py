"""A derivation for people: as text that copies into code, as LaTeX in the paper's notation, as one JSON document."""
