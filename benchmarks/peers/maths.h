/* Elementary functions without branches, so that a loop over lanes vectorises.

   REAL is float or double. Single precision has minimax polynomials, double precision
   series to rounding. With -DPLAIN the functions of the C library are used instead. */

#include <stdint.h>
#include <string.h>
#include <tgmath.h>

typedef REAL real;
#define INLINE static inline __attribute__((always_inline))
#define PI ((real)3.14159265358979323846)
#define SINGLE (sizeof(real) == 4)

INLINE real larger(real a, real b) { return a > b ? a : b; }
INLINE real smaller(real a, real b) { return a < b ? a : b; }
INLINE real clip(real x, real low, real high) { return smaller(larger(x, low), high); }

/* c[0] + c[1] x + c[2] x^2 + ... */
INLINE real horner(real x, int terms, const double *c)
{
    real sum = (real)c[terms - 1];
#pragma GCC unroll 16
    for (int i = terms - 2; i >= 0; i--)
        sum = sum * x + (real)c[i];
    return sum;
}
#define POLYNOMIAL(x, ...)                                                            \
    horner(x, sizeof((double[]){__VA_ARGS__}) / sizeof(double), (double[]){__VA_ARGS__})

#ifdef DOUBLE
typedef int64_t bits;
#define MANTISSA 52
#define ROOT_HALF 0x3fe6a09e667f3bcdLL
#define EXPONENT_REACH 1022.0
#define PI_PARTS 3.1415926534682512, 1.2154201012607932e-10, 4.044532497591901e-21
#else
typedef int32_t bits;
#define MANTISSA 23
#define ROOT_HALF 0x3f3504f3
#define EXPONENT_REACH 126.0f
#define PI_PARTS 3.140625f, 9.675025939941406e-4f, 1.5099579897537296e-7f
#endif

INLINE bits as_bits(real x) { return ((union { real r; bits b; }){.r = x}).b; }
INLINE real as_real(bits b) { return ((union { bits b; real r; }){.b = b}).r; }

/* By the bits: -ffast-math may assume that every number is finite. */
INLINE int is_finite(real x)
{
    const bits exponent = (((bits)1 << (8 * sizeof(real) - 1 - MANTISSA)) - 1) << MANTISSA;
    return (as_bits(x) & exponent) != exponent;
}

#ifdef PLAIN

INLINE real log_2(real x) { return log(x) * (real)1.4426950408889634; }
INLINE real exp_2(real x) { return exp(x * (real)0.6931471805599453); }
INLINE void sine_cosine(real x, real *sine, real *cosine)
{
    *sine = sin(x);
    /* Not cos(x): the compiler would join the two into one call that does not vectorise. */
    *cosine = sin(x + PI / 2);
}

#else

/* Sine and cosine after whole half turns are taken off. */
INLINE void sine_cosine(real x, real *sine, real *cosine)
{
    static const real part[3] = {PI_PARTS};
    real turns = rint(x * (1 / PI));
    real y = ((x - turns * part[0]) - turns * part[1]) - turns * part[2], z = y * y;
    real sign = 1 - 2 * (turns - 2 * floor(turns * (real)0.5));
#ifdef DOUBLE
    real s = POLYNOMIAL(z, 1, -1.0 / 6, 1.0 / 120, -1.0 / 5040, 1.0 / 362880,
                        -1.0 / 39916800, 1.0 / 6227020800, -1.0 / 1307674368000,
                        1.0 / 355687428096000, -1.0 / 121645100408832000,
                        1.0 / 51090942171709440000.0);
    real c = POLYNOMIAL(z, 1, -0.5, 1.0 / 24, -1.0 / 720, 1.0 / 40320, -1.0 / 3628800,
                        1.0 / 479001600, -1.0 / 87178291200, 1.0 / 20922789888000,
                        -1.0 / 6402373705728000, 1.0 / 2432902008176640000,
                        -1.0 / 1124000727777607680000.0);
#else
    real s = POLYNOMIAL(z, 9.99999995e-1, -1.66666567e-1, 8.33302514e-3,
                        -1.98074187e-4, 2.60190303e-6);
    real c = POLYNOMIAL(z, 1, -4.99999994e-1, 4.16666363e-2, -1.38883614e-3,
                        2.47601613e-5, -2.60514949e-7);
#endif
    *sine = sign * y * s;
    *cosine = sign * c;
}

/* Sine and cosine of what an angle turns by within a tick. */
INLINE void small_sine_cosine(real x, real *sine, real *cosine)
{
    real z = x * x;
#ifdef DOUBLE
    *sine = x * POLYNOMIAL(z, 1, -1.0 / 6, 1.0 / 120, -1.0 / 5040, 1.0 / 362880,
                           -1.0 / 39916800, 1.0 / 6227020800, -1.0 / 1307674368000);
    *cosine = POLYNOMIAL(z, 1, -0.5, 1.0 / 24, -1.0 / 720, 1.0 / 40320, -1.0 / 3628800,
                         1.0 / 479001600, -1.0 / 87178291200);
#else
    *sine = x * POLYNOMIAL(z, 1, -1.0 / 6, 1.0 / 120, -1.0 / 5040);
    *cosine = POLYNOMIAL(z, 1, -0.5, 1.0 / 24, -1.0 / 720);
#endif
}

/* Binary logarithm of a positive number: exponent, and a mantissa in [sqrt 1/2, sqrt 2). */
INLINE real log_2(real x)
{
    bits b = as_bits(x) - ROOT_HALF;
    real exponent = (real)(b >> MANTISSA);
    real m = as_real((b & (((bits)1 << MANTISSA) - 1)) + ROOT_HALF);
#ifdef DOUBLE
    real s = (m - 1) / (m + 1), z = s * s, k = 2 * 1.4426950408889634;
    return exponent + s * k * POLYNOMIAL(z, 1, 1.0 / 3, 1.0 / 5, 1.0 / 7, 1.0 / 9,
                                         1.0 / 11, 1.0 / 13, 1.0 / 15, 1.0 / 17,
                                         1.0 / 19, 1.0 / 21);
#else
    real f = m - 1;
    return exponent + f * POLYNOMIAL(f, 1.442695, -0.72134735, 0.48091064, -0.36070367,
                                     0.28791623, -0.23894499, 0.21571592, -0.20726869,
                                     0.12583485);
#endif
}

/* 2^x: the nearest whole number goes into the exponent, the rest through a polynomial. */
INLINE real exp_2(real x)
{
    x = clip(x, -EXPONENT_REACH, EXPONENT_REACH);
    real whole = rint(x), f = x - whole;
#ifdef DOUBLE
    real m = POLYNOMIAL(f, 1, 6.931471805599453e-1, 2.4022650695910072e-1,
                        5.550410866482158e-2, 9.618129107628477e-3,
                        1.3333558146428443e-3, 1.5403530393381608e-4,
                        1.5252733804059838e-5, 1.321548679014431e-6,
                        1.01780860092396999e-7, 7.054911620801123e-9,
                        4.445538271870811e-10, 2.567843599348820e-11,
                        1.369148885390412e-12);
#else
    real m = POLYNOMIAL(f, 1, 6.93147206e-1, 2.40226469e-1, 5.55032878e-2,
                        9.61848898e-3, 1.33999312e-3, 1.53458061e-4);
#endif
    return as_real(as_bits(m) + ((bits)whole << MANTISSA));
}

/* x^(-1/4) to 4 %, from the bits alone: good enough to start an iteration. */
INLINE real rough_inverse_fourth_root(real x)
{
    const bits one = (bits)((1 << (8 * sizeof(real) - 2 - MANTISSA)) - 1) << MANTISSA;
    return (real)0.96 * as_real(one + (one >> 2) - (as_bits(x) >> 2));
}

#endif
