"""Target ``riscv32``: the controller on a RISC-V with 32 bits, emulated."""

from typing import Final

from pmjoint_codegen.export.pil.target import target_of

TARGET: Final = target_of("riscv32")
