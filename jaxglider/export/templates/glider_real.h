/* Floating numbers of the exported code, and arithmetic as XLA has it. */
#ifndef GLIDER_REAL_H
#define GLIDER_REAL_H

/* A missing number is NaN, and the guards against it ask whether x != x. These options
   let a compiler take it that there is no NaN, and it then removes the guards. */
#if defined(__FAST_MATH__) || defined(_M_FP_FAST)
#error "-ffast-math and -Ofast remove the guards against NaN: compile with -O3"
#elif defined(__FINITE_MATH_ONLY__)
#if __FINITE_MATH_ONLY__
#error "-ffinite-math-only removes the guards against NaN: leave it out"
#endif
#endif

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* Double precision, or single with -DGLIDER_FLOAT. */
#ifdef GLIDER_FLOAT
typedef float glider_real;
typedef int32_t glider_bits;
#define GLIDER_MATH(name) name##f
#else
typedef double glider_real;
typedef int64_t glider_bits;
#define GLIDER_MATH(name) name
#endif

#define REAL(number) ((glider_real)(number))

#define real_fabs GLIDER_MATH(fabs)
#define real_acos GLIDER_MATH(acos)
#define real_acosh GLIDER_MATH(acosh)
#define real_asin GLIDER_MATH(asin)
#define real_asinh GLIDER_MATH(asinh)
#define real_atan GLIDER_MATH(atan)
#define real_atan2 GLIDER_MATH(atan2)
#define real_atanh GLIDER_MATH(atanh)
#define real_cbrt GLIDER_MATH(cbrt)
#define real_ceil GLIDER_MATH(ceil)
#define real_cos GLIDER_MATH(cos)
#define real_cosh GLIDER_MATH(cosh)
#define real_erf GLIDER_MATH(erf)
#define real_exp GLIDER_MATH(exp)
#define real_exp2 GLIDER_MATH(exp2)
#define real_expm1 GLIDER_MATH(expm1)
#define real_floor GLIDER_MATH(floor)
#define real_fmod GLIDER_MATH(fmod)
#define real_log GLIDER_MATH(log)
#define real_log1p GLIDER_MATH(log1p)
#define real_nextafter GLIDER_MATH(nextafter)
#define real_pow GLIDER_MATH(pow)
#define real_rint GLIDER_MATH(rint)
#define real_round GLIDER_MATH(round)
#define real_sin GLIDER_MATH(sin)
#define real_sinh GLIDER_MATH(sinh)
#define real_sqrt GLIDER_MATH(sqrt)
#define real_tan GLIDER_MATH(tan)
#define real_tanh GLIDER_MATH(tanh)

/* The larger number; NaN where either is. */
static inline glider_real real_max(const glider_real a, const glider_real b)
{
    return a != a ? a : b != b ? b : a > b ? a : b;
}

/* The smaller number; NaN where either is. */
static inline glider_real real_min(const glider_real a, const glider_real b)
{
    return a != a ? a : b != b ? b : a < b ? a : b;
}

/* -1, 0 or 1; NaN of NaN. */
static inline glider_real real_sign(const glider_real a)
{
    return a > 0 ? REAL(1.0) : a < 0 ? REAL(-1.0) : a;
}

/* Toward zero, kept within range; 0 of NaN. */
static inline int32_t real_to_int32(const glider_real a)
{
    if (a != a) {
        return 0;
    }
    if (a >= REAL(2147483647.0)) {
        return INT32_MAX;
    }
    if (a <= REAL(-2147483648.0)) {
        return INT32_MIN;
    }
    return (int32_t)a;
}

/* The product of two matrices over their first index: r[i][j] = sum of a[n][i] b[n][j]. */
static inline void real_product(
    const glider_real *a, const glider_real *b, glider_real *r, const int size,
    const int rows, const int columns)
{
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < columns; j++) {
            glider_real sum = a[i] * b[j];
            for (int n = 1; n < size; n++) {
                sum = sum + a[n * rows + i] * b[n * columns + j];
            }
            r[i * columns + j] = sum;
        }
    }
}

static inline glider_bits real_to_bits(const glider_real a)
{
    glider_bits bits;
    memcpy(&bits, &a, sizeof bits);
    return bits;
}

static inline glider_real real_from_bits(const glider_bits bits)
{
    glider_real a;
    memcpy(&a, &bits, sizeof a);
    return a;
}

#endif
