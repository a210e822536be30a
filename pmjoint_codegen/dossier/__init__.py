"""A model as one page for a reader who wants to judge it: from the sources to what is not covered."""
