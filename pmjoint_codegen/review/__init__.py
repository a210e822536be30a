"""What a change of a model changes: a revision of git against the working tree."""
