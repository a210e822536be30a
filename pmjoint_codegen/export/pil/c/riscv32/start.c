/* Start of a RISC-V with 32 bits and single-precision floating point; minstret counts the instructions. */
#include "chip.h"
#include "semihosting.h"

enum { FAULT = 3 };

void fault(void);

void fault(void)
{
    leave(FAULT);
}

/* The thread pointer: picolibc keeps errno in thread-local memory. */
__asm__(".section .init, \"ax\"\n"
        ".global start\n"
        "start:\n"
        ".option push\n"
        ".option norelax\n"
        "la gp, __global_pointer$\n"
        ".option pop\n"
        "la sp, stack_top\n"
        "la tp, thread_start\n"
        "la t0, trap\n"
        "csrw mtvec, t0\n"
        "li t0, 0x2000\n" /* mstatus.FS: floating point on */
        "csrs mstatus, t0\n"
        "csrw fcsr, zero\n"
        "call begin\n"
        ".balign 4\n"
        "trap:\n"
        "call fault\n"
        ".text\n");

uint32_t chip_ticks(void)
{
    uint32_t found;
    __asm__ volatile("csrr %0, minstret" : "=r"(found));
    return found;
}

intptr_t semihost(uint32_t operation, const void *block)
{
    register uint32_t a0 __asm__("a0") = operation;
    register const void *a1 __asm__("a1") = block;
    /* The three are one mark: not compressed, and in one page. */
    __asm__ volatile(".balign 16\n\t"
                     ".option push\n\t"
                     ".option norvc\n\t"
                     "slli x0, x0, 0x1f\n\t"
                     "ebreak\n\t"
                     "srai x0, x0, 7\n\t"
                     ".option pop"
                     : "+r"(a0)
                     : "r"(a1)
                     : "memory");
    return (intptr_t)a0;
}

__attribute__((noinline)) void chip_nothing(void)
{
    __asm__ volatile("");
}

__attribute__((noinline)) void chip_block(void)
{
    __asm__ volatile(".rept 256\n\tnop\n\t.endr");
}
