/* Whether this library computes according to IEEE 754 and the C standard. Every build contains it, and a separate
   process calls it before any other loads the library.

   The result has one bit for each broken rule; library.py has the messages. Operands are volatile, so that the
   compiler computes nothing itself; it may only rearrange the expressions between them. */

unsigned pmjoint_self_test(void);

enum { DENORMALS = 1, ORDER = 2, DIVISION = 4, CONTRACTION = 8, PRECISION = 16, SPECIAL = 32 };

static const volatile double SMALLEST_NORMAL = 0x1p-1022, DENORMAL = 0x1p-1030, LARGE = 0x1p+100;
static const volatile double ONE = 1.0, HALF_ULP = 0x1p-53, BELOW = 0x1p-64, NEAR_ONE = 0x1.0000001p+0;
static const volatile double DIVISOR = 49.0, NUMERATORS[4] = {5.0, 9.0, 10.0, 11.0};
static const volatile double QUOTIENTS[4] = {
    0x1.a1f58d0fac688p-4, 0x1.7829cbc14e5e1p-3, 0x1.a1f58d0fac688p-3, 0x1.cbc14e5e0a72fp-3};
static const volatile double MINUS_ZERO = -0.0, ZERO = 0.0;

/* A flushed result is 0, and so is a flushed operand. */
static unsigned keeps_denormals(void)
{
    const double flushed_result = SMALLEST_NORMAL * 0.25, flushed_operand = DENORMAL * LARGE;
    return flushed_result > 0.0 && flushed_operand > 0.0 ? 0 : DENORMALS;
}

/* Small terms are lost if added one by one, and kept if they are summed first. */
static unsigned adds_in_order(void)
{
    const double one = ONE, half = HALF_ULP;
    const double lost = (one + half) - one, twice = ((one + half) + half) - one, kept = one + (half + half);
    return lost == 0.0 && twice == 0.0 && kept > one ? 0 : ORDER;
}

/* One divisor invites its reciprocal, which rounds these four to another double. */
static unsigned divides(void)
{
    const double divisor = DIVISOR, a = NUMERATORS[0] / divisor, b = NUMERATORS[1] / divisor;
    const double c = NUMERATORS[2] / divisor, d = NUMERATORS[3] / divisor;
    const int same = (a == QUOTIENTS[0]) + (b == QUOTIENTS[1]) + (c == QUOTIENTS[2]) + (d == QUOTIENTS[3]);
    return same == 4 ? 0 : DIVISION;
}

/* The product rounds to 1 + 2^-27; a fused operation keeps the 2^-56 that this loses. */
static unsigned rounds_products(void)
{
    const double factor = NEAR_ONE, product = 0x1.0000002p+0;
    return factor * factor - product == 0.0 ? 0 : CONTRACTION;
}

/* Rounded to 64 bits first, the sum falls half way between two doubles, and then to the lower; a constant
   that is kept as a float is not a tenth. */
static unsigned rounds_once(void)
{
    const volatile double one = ONE, little = HALF_ULP + BELOW, tenth = 0.1;
    const volatile double sum = one + little;
    return sum > one && tenth == one / 10.0 ? 0 : PRECISION;
}

/* 1/(-0 + 0) is +inf, inf - inf is NaN. */
static unsigned keeps_special_values(void)
{
    const double infinite = ONE / (MINUS_ZERO + 0.0), none = infinite - ONE / ZERO;
    return infinite > 1.0 && none != none ? 0 : SPECIAL;
}

unsigned pmjoint_self_test(void)
{
    return keeps_denormals() | adds_in_order() | divides() | rounds_products() | rounds_once() |
           keeps_special_values();
}
