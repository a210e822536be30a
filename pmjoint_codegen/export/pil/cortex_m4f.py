"""Target ``cortex-m4f``: the controller on an Arm Cortex-M4F, emulated."""

from typing import Final

from pmjoint_codegen.export.pil.target import target_of

TARGET: Final = target_of("cortex-m4f")
