"""The effects of a change of a model: a revision of git compared with the working tree."""
