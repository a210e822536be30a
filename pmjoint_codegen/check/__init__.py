"""The grounds for trusting the generated code: gates that check it against the derivation, and can fail."""
