/* The same for this machine, whose instructions are not counted and whose stack is not measured. */
#include "chip.h"

#include <stdio.h>

static FILE *files[2];

int chip_open(const char *name, int writes)
{
    files[writes] = fopen(name, (writes != 0) ? "wb" : "rb");
    if (files[writes] != NULL) {
        (void)setvbuf(files[writes], NULL, _IONBF, 0); /* a record is answered before the next is read */
    }
    return (files[writes] == NULL) ? -1 : writes;
}

size_t chip_read(int handle, void *to, size_t size)
{
    return fread(to, 1, size, files[handle]);
}

int chip_write(int handle, const void *from, size_t size)
{
    return (fwrite(from, 1, size, files[handle]) == size) ? 0 : 1;
}

void chip_close(int handle)
{
    (void)fclose(files[handle]);
}

uint32_t chip_ticks(void)
{
    return 0;
}

void chip_nothing(void)
{
}

void chip_block(void)
{
}

uintptr_t chip_paint(void)
{
    return 0;
}

uint32_t chip_depth(uintptr_t base)
{
    (void)base;
    return 0;
}
