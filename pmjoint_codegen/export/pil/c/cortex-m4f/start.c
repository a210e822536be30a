/* Start of a Cortex-M4F: vectors, floating-point unit, SysTick as the counter of instructions. */
#include "chip.h"
#include "semihosting.h"

typedef volatile uint32_t reg;
#define SYST_CSR (*(reg *)0xE000E010u)
#define SYST_RVR (*(reg *)0xE000E014u)
#define SYST_CVR (*(reg *)0xE000E018u)
#define CPACR (*(reg *)0xE000ED88u)

enum { EXCEPTIONS = 15, FAULT = 3 };

void start(void);
static void fault(void);

typedef void (*handler)(void);
/* link.ld puts the initial stack pointer before them. */
__attribute__((section(".vectors"), used)) static const handler vectors[EXCEPTIONS] = {
    start, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault,
};

static void fault(void)
{
    leave(FAULT);
}

/* Nothing here may use the floating-point unit, which is off. */
void start(void)
{
    CPACR |= 0xFu << 20; /* full access to coprocessors 10 and 11 */
    __asm__ volatile("dsb\n\tisb" ::: "memory");
    SYST_RVR = CHIP_TICKS_MASK;
    SYST_CVR = 0;
    SYST_CSR = 5u; /* on, clock of the processor, no interrupt */
    begin();
}

uint32_t chip_ticks(void)
{
    return CHIP_TICKS_MASK - SYST_CVR; /* it counts down */
}

intptr_t semihost(uint32_t operation, const void *block)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = block;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return (intptr_t)r0;
}

__attribute__((noinline)) void chip_nothing(void)
{
    __asm__ volatile("");
}

__attribute__((noinline)) void chip_block(void)
{
    __asm__ volatile(".rept 256\n\tnop\n\t.endr");
}
