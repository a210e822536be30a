"""What gates check against: references that share no code with what they judge."""
