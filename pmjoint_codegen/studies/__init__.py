"""Studies of a model in one call: many runs, and gains found over many runs.

spec    settings as Python writes them -> the texts of the command line, so that both mean the same
watch   how a study reports its stages
sweep   `pmjoint_codegen.sweep(...)`, which ``pmjoint sweep`` uses too
tune    `pmjoint_codegen.tune(...)`, which ``pmjoint tune`` uses too
"""
