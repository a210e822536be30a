"""The processors that a controller can be run on: how to compile for each, and how to emulate it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

BLOCK: Final = 256  # instructions of ``chip_block`` in chip.h
_SEMIHOSTING: Final = "-semihosting-config enable=on,target=native"
_QUIET: Final = "-nographic -monitor none -serial none"


@dataclass(frozen=True)
class Chip:
    """A processor and its emulation.

    Attributes:
        name: of the target, and of the folder of its start-up code.
        title: for readers.
        prefix: of the programs of its tool chain.
        flags: of its compiler, as a shell takes them.
        emulator: program.
        board: arguments of the emulator: the board, and the clock that advances with instructions.
        rate: how far the counter of start.c goes with each instruction.
        mask: largest value of the counter.
        packages: Debian packages that compile for it and emulate it.
    """

    name: str
    title: str
    prefix: str
    flags: str
    emulator: str
    board: str
    rate: float
    mask: int
    packages: str

    @property
    def compiler(self) -> str:
        """Name of its compiler."""
        return f"{self.prefix}gcc"

    @property
    def emulation(self) -> str:
        """The emulator's command as far as the image, as a shell takes it."""
        return f"{self.emulator} {self.board} {_QUIET} {_SEMIHOSTING}"


# QEMU's clock goes on by 2^shift ns with every instruction. SysTick of MPS2 counts at 25 MHz, so an
# instruction of 128 ns is 3.2 counts, and its 24 bits last for five million instructions. minstret counts the
# clock's nanoseconds.
CHIPS: Final = (
    Chip(
        name="cortex-m4f",
        title="Arm Cortex-M4F",
        prefix="arm-none-eabi-",
        flags="-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard",
        emulator="qemu-system-arm",
        board="-M mps2-an386 -icount shift=7",
        rate=3.2,
        mask=0xFFFFFF,
        packages="gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm make",
    ),
    Chip(
        name="riscv32",
        title="RISC-V RV32IMAFC",
        prefix="riscv64-unknown-elf-",
        flags="-march=rv32imafc -mabi=ilp32f -mcmodel=medany --specs=picolibc.specs",
        emulator="qemu-system-riscv32",
        board="-M virt -bios none -icount shift=0",
        rate=1.0,
        mask=0xFFFFFFFF,
        packages="gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf qemu-system-misc make",
    ),
)


def chip_named(name: str) -> Chip:
    """The chip of a name in the table."""
    (found,) = (chip for chip in CHIPS if chip.name == name)
    return found
