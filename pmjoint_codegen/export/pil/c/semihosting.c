/* Files of the machine that emulates, by semihosting (Arm's document of 2.0, which RISC-V follows); the memory's
 * start; and how much stack is used. */
#include "semihosting.h"

#include "chip.h"

#define PATTERN 0x5a5a5a5au

enum { OPEN = 0x01, CLOSE = 0x02, WRITE = 0x05, READ = 0x06, EXIT_EXTENDED = 0x20 };
enum { READ_BINARY = 1, WRITE_BINARY = 5 };
#define APPLICATION_EXIT 0x20026u

extern uint32_t data_load[], data_start[], data_end[], bss_start[], bss_end[], stack_low[];

int main(void);

int chip_open(const char *name, int writes)
{
    size_t length = 0;
    while (name[length] != '\0') {
        ++length;
    }
    const uintptr_t block[3] = {(uintptr_t)name, (writes != 0) ? WRITE_BINARY : READ_BINARY, length};
    return (int)semihost(OPEN, block);
}

size_t chip_read(int handle, void *to, size_t size)
{
    size_t left = size;
    int more = 1;
    while ((left > 0u) && (more != 0)) { /* a pipe may give less than it was asked for */
        const uintptr_t block[3] = {(uintptr_t)handle, (uintptr_t)to + (size - left), left};
        const size_t rest = (size_t)semihost(READ, block);
        more = (rest < left) ? 1 : 0;
        left = (more != 0) ? rest : left;
    }
    return size - left;
}

int chip_write(int handle, const void *from, size_t size)
{
    const uintptr_t block[3] = {(uintptr_t)handle, (uintptr_t)from, size};
    return (semihost(WRITE, block) == 0) ? 0 : 1;
}

void chip_close(int handle)
{
    const uintptr_t block[1] = {(uintptr_t)handle};
    (void)semihost(CLOSE, block);
}

uintptr_t chip_paint(void)
{
    const uintptr_t top = stack_pointer(); /* of the caller: a leaf this small pushes nothing */
    for (volatile uint32_t *word = stack_low; (uintptr_t)word < top; ++word) {
        *word = PATTERN;
    }
    return top;
}

uint32_t chip_depth(uintptr_t base)
{
    const volatile uint32_t *word = stack_low;
    while (((uintptr_t)word < base) && (*word == PATTERN)) {
        ++word;
    }
    return (uint32_t)(base - (uintptr_t)word);
}

void leave(uint32_t status)
{
    const uintptr_t block[2] = {APPLICATION_EXIT, status};
    for (;;) {
        (void)semihost(EXIT_EXTENDED, block);
    }
}

void begin(void)
{
    const uint32_t *from = data_load;
    for (uint32_t *to = data_start; to < data_end; ++to) {
        *to = *from;
        ++from;
    }
    for (uint32_t *to = bss_start; to < bss_end; ++to) {
        *to = 0;
    }
    leave((uint32_t)main());
}
