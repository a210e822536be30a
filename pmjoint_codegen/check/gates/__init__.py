"""One module a gate of `pmjoint_codegen.check.table`."""
