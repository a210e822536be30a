"""Why anyone may trust the generated code: gates that hold it against the derivation, and can fail."""
