"""The references of the gates; they share no code with the checked side."""
