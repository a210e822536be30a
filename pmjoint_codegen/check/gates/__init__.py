"""One module per gate of `pmjoint_codegen.check.table`."""
