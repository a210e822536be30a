"""The command line: one module per command. Each imports heavy libraries only when it runs."""
