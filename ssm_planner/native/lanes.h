/* Vectors of four numbers, one for each of four elements. The same operations in the same order
 * run on every processor, so all of them give the same bits. */

#ifndef SSM_LANES_H
#define SSM_LANES_H

#include <math.h>

#pragma GCC diagnostic ignored "-Wpsabi"

#define LANES 4

typedef double real __attribute__((vector_size(8 * LANES)));
typedef long long mask __attribute__((vector_size(8 * LANES)));

/* Return a vector of four equal numbers. */
static inline real R(double x)
{
    real all = {x, x, x, x};
    return all;
}

/* Return a vector of four equal integers. */
static inline mask M(long long x)
{
    mask all = {x, x, x, x};
    return all;
}

/* 1 where the condition is true, 0 elsewhere. */
static inline real v_is(mask condition) { return (real)(condition & (mask)R(1.0)); }
/* x where the condition is true, 0 elsewhere. */
static inline real v_where(mask condition, real x) { return (real)(condition & (mask)x); }
/* x where the condition is true, y elsewhere. */
static inline real v_choose(mask condition, real x, real y)
{
    return (real)((condition & (mask)x) | (~condition & (mask)y));
}
static inline real v_fabs(real x) { return (real)((mask)x & M(0x7fffffffffffffff)); }
static inline real sign_of(real x) { return v_is(x > R(0.0)) - v_is(x < R(0.0)); }

/* Define a function of vectors that calls a function of the C library for each entry. */
#define BY_LANE(name, function)                                                                    \
    static inline real name(real x)                                                                \
    {                                                                                              \
        for (int k = 0; k < LANES; k++) x[k] = function(x[k]);                                     \
        return x;                                                                                  \
    }
BY_LANE(v_exp, exp)
BY_LANE(v_sqrt, sqrt)
BY_LANE(sin_by_lane, sin)
BY_LANE(cos_by_lane, cos)

static inline real v_atan2(real y, real x)
{
    for (int k = 0; k < LANES; k++) y[k] = atan2(y[k], x[k]);
    return y;
}

/* ---- Sine and cosine, with an error below one unit of the last digit
 *
 * The nearest multiple n pi / 2 is subtracted from x. To keep this exact, pi / 2 is split into its
 * first 33 bits, the next 33 bits and the rest. Then the polynomials of k_sin.c and k_cos.c of
 * fdlibm are evaluated (Sun Microsystems, 1993). */

static const double LARGEST_ANGLE = 1e5; /* rad; for larger angles, n pi / 2 is not exact enough */

typedef struct {
    mask n; /* integer whose last two bits are those of the number of subtracted quarter turns */
    real x, rest; /* reduced angle x + rest, rad, about between -pi / 4 and pi / 4 */
} ReducedAngle;

/* Subtract the nearest multiple of pi / 2 from x. */
static inline ReducedAngle reduce_angle(real x)
{
    const real rounder = R(0x1.8p52), moved = x * R(6.36619772367581382433e-01) + rounder,
               n = moved - rounder;
    const real first = x - n * R(1.57079632673412561417e+00),
               next = n * R(6.07710050630396597660e-11);
    const real second = first - next,
               last = n * R(2.02226624879595063154e-21) - ((first - second) - next);
    const real reduced = second - last;
    const ReducedAngle result = {(mask)moved, reduced, (second - reduced) - last};
    return result;
}

/* Return the sine of the reduced angle. */
static inline real reduced_sine(ReducedAngle t)
{
    const real z = t.x * t.x, v = z * t.x;
    const real r =
        R(8.33333333332248946124e-03) +
        z * (R(-1.98412698298579493134e-04) +
             z * (R(2.75573137070700676789e-06) +
                  z * (R(-2.50507602534068634195e-08) + z * R(1.58969099521155010221e-10))));
    return t.x - ((z * (R(0.5) * t.rest - v * r) - t.rest) - v * R(-1.66666666666666324348e-01));
}

/* Return the cosine of the reduced angle. */
static inline real reduced_cosine(ReducedAngle t)
{
    const real z = t.x * t.x, half = R(0.5) * z, w = R(1.0) - half;
    const real r = z * (R(4.16666666666666019037e-02) +
                        z * (R(-1.38888888888741095749e-03) +
                             z * (R(2.48015872894767294178e-05) +
                                  z * (R(-2.75573143513906633035e-07) +
                                       z * (R(2.08757232129817482790e-09) +
                                            z * R(-1.13596475577881948265e-11))))));
    return w + (((R(1.0) - w) - half) + (z * r - t.x * t.rest));
}

/* Return the sine of the angle after `quarters` more quarter turns. */
static inline real shifted_sine(ReducedAngle t, long long quarters)
{
    const mask n = t.n + M(quarters);
    const real result = v_choose((n & M(1)) != M(0), reduced_cosine(t), reduced_sine(t));
    return (real)((mask)result ^ ((n & M(2)) << 62));
}

/* Return 1 if one of the angles is larger than LARGEST_ANGLE, infinite or NaN. */
static inline int is_far(real x)
{
    int far_lanes = 0;
    for (int k = 0; k < LANES; k++) far_lanes |= !(fabs(x[k]) < LARGEST_ANGLE);
    return far_lanes;
}

static inline real v_sin(real x)
{
    const real result = shifted_sine(reduce_angle(x), 0);
    return is_far(x) ? sin_by_lane(x) : result;
}

static inline real v_cos(real x)
{
    const real result = shifted_sine(reduce_angle(x), 1);
    return is_far(x) ? cos_by_lane(x) : result;
}

#endif
