/* What start.c and semihosting.c know of each other. */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stdint.h>

/** One call of the machine that emulates. */
intptr_t semihost(uint32_t operation, const void *block);

/** Fill in the memory, run main, leave with its result. */
void begin(void);

/** End the emulation. */
void leave(uint32_t status);

/** The stack pointer. */
static inline uintptr_t stack_pointer(void)
{
    uintptr_t found;
    __asm__ volatile("add %0, sp, 0" : "=r"(found)); /* as Arm and RISC-V both spell it */
    return found;
}

#endif
