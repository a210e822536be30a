"""From C sources to a shared library in the user's cache folder."""
