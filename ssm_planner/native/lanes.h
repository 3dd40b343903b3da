/* Numbers of four elements at once. Every processor takes the same operations in the same order. */

#ifndef SSM_LANES_H
#define SSM_LANES_H

#include <math.h>

#pragma GCC diagnostic ignored "-Wpsabi"

#define LANES 4

typedef double real __attribute__((vector_size(8 * LANES)));
typedef long long mask __attribute__((vector_size(8 * LANES)));

static inline real R(double x)
{
    real all = {x, x, x, x};
    return all;
}

static inline mask M(long long x)
{
    mask all = {x, x, x, x};
    return all;
}

static inline real v_is(mask condition) { return (real)(condition & (mask)R(1.0)); }
static inline real v_where(mask condition, real x) { return (real)(condition & (mask)x); }
static inline real v_choose(mask condition, real x, real y) { return (real)((condition & (mask)x) | (~condition & (mask)y)); }
static inline real v_fabs(real x) { return (real)((mask)x & M(0x7fffffffffffffff)); }
static inline real sign_of(real x) { return v_is(x > R(0.0)) - v_is(x < R(0.0)); }

#define BY_LANE(name, function)                                \
    static inline real name(real x)                            \
    {                                                          \
        for (int k = 0; k < LANES; k++) x[k] = function(x[k]); \
        return x;                                              \
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

/* ---- sine and cosine, to less than one unit of the last place: x less the nearest n pi / 2, of which the first 33 bits, the
 * next 33 and the rest are taken, and the polynomials of fdlibm's k_sin.c and k_cos.c (Sun Microsystems, 1993). */

static const double FAR = 1e5; /* beyond it n pi / 2 is not exact enough */

typedef struct {
    mask n;
    real x, rest; /* x + rest within pi / 4 of 0 */
} Turn;

static inline Turn turn_of(real x)
{
    const real whole = R(0x1.8p52), moved = x * R(6.36619772367581382433e-01) + whole, n = moved - whole;
    const real first = x - n * R(1.57079632673412561417e+00), next = n * R(6.07710050630396597660e-11);
    const real second = first - next, last = n * R(2.02226624879595063154e-21) - ((first - second) - next);
    const real near = second - last;
    const Turn found = {(mask)moved, near, (second - near) - last};
    return found;
}

static inline real sin_near(Turn t)
{
    const real z = t.x * t.x, v = z * t.x;
    const real r = R(8.33333333332248946124e-03) +
                   z * (R(-1.98412698298579493134e-04) +
                        z * (R(2.75573137070700676789e-06) +
                             z * (R(-2.50507602534068634195e-08) + z * R(1.58969099521155010221e-10))));
    return t.x - ((z * (R(0.5) * t.rest - v * r) - t.rest) - v * R(-1.66666666666666324348e-01));
}

static inline real cos_near(Turn t)
{
    const real z = t.x * t.x, half = R(0.5) * z, w = R(1.0) - half;
    const real r = z * (R(4.16666666666666019037e-02) +
                        z * (R(-1.38888888888741095749e-03) +
                             z * (R(2.48015872894767294178e-05) +
                                  z * (R(-2.75573143513906633035e-07) +
                                       z * (R(2.08757232129817482790e-09) + z * R(-1.13596475577881948265e-11))))));
    return w + (((R(1.0) - w) - half) + (z * r - t.x * t.rest));
}

/* sine of t after `quarters` more quarters of a turn */
static inline real sin_turned(Turn t, long long quarters)
{
    const mask n = t.n + M(quarters);
    const real found = v_choose((n & M(1)) != M(0), cos_near(t), sin_near(t));
    return (real)((mask)found ^ ((n & M(2)) << 62));
}

static inline int is_far(real x)
{
    int far = 0;
    for (int k = 0; k < LANES; k++) far |= !(fabs(x[k]) < FAR);
    return far;
}

static inline real v_sin(real x)
{
    const real found = sin_turned(turn_of(x), 0);
    return is_far(x) ? sin_by_lane(x) : found;
}

static inline real v_cos(real x)
{
    const real found = sin_turned(turn_of(x), 1);
    return is_far(x) ? cos_by_lane(x) : found;
}

#endif
