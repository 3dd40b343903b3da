/* What program.c (values) and derivatives.c share. */

#ifndef SSM_PROGRAM_H
#define SSM_PROGRAM_H

#include "interior.h"

/* a call in which `m`, the number of coordinates, is a constant, so that the compiler knows the length of every loop over them */
#define FOR_COORDINATES(count, call)                          \
    switch (count) {                                          \
    case 1: { enum { m = 1 }; call; break; }                  \
    case 2: { enum { m = 2 }; call; break; }                  \
    case 3: { enum { m = 3 }; call; break; }                  \
    case COORDINATES: { enum { m = COORDINATES }; call; break; } \
    }

/* entry of z of the first coordinate of given row o */
static inline long entry(long o, long m)
{
    return o * m + (o == LOCAL);
}

static inline double total(const double *values, long count)
{
    double sum = 0.0;
    for (long i = 0; i < count; i++)
        sum += values[i];
    return sum;
}

/* s = sum T / S_0; 1 of nodes that hold the velocity itself */
static inline double stretch_of(const Evaluator *e, const double *times)
{
    const double from = e->program->stretched_from;
    return from > 0.0 ? total(times, e->b) / from : 1.0;
}

/* lengths eta of element k at times T */
static inline void eta_of(const Evaluator *e, const double *times, double stretch, long k, double eta[WIDEST])
{
    const Program *p = e->program;
    if (e->kind == HERMITE) {
        eta[0] = p->fractions[k] * times[p->block[k]];
        eta[1] = stretch;
        return;
    }
    for (long j = 0; j < WIDEST; j++) {
        const long at = k + j - 2;
        eta[j] = at < 0 || at >= e->n ? 0.0 : p->fractions[at] * times[p->block[at]];
    }
}

/* row l of A times z */
static inline double linear_value(const Evaluator *e, long l, const double *z)
{
    double sum = 0.0;
    for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++)
        sum += e->a_value[a] * z[e->a_column[a]];
    return sum;
}

/* derivative of e var(T / T_least) by T_i: e 2 / b (T_i / l_i - mean of T / l) / l_i */
static inline double evenness_slope(const Evaluator *e, const double *times, long i)
{
    const double *least = e->program->least_times, b = (double)e->b;
    double mean = 0.0;
    if (e->program->even == 0.0)
        return 0.0;
    for (long j = 0; j < e->b; j++)
        mean += times[j] / least[j] / b;
    return 2.0 * e->program->even / b * (times[i] / least[i] - mean) / least[i];
}

/* sum of p_i (a_0^2 + a_0 a_1 + a_1^2)_i of an element */
static inline double smoothing(const Evaluator *e, const double *z)
{
    const double *first = z + 2 * e->m, *last = z + 3 * e->m;
    double sum = 0.0;
    for (long i = 0; i < e->m; i++)
        sum += e->program->smoothing[i] * (first[i] * first[i] + first[i] * last[i] + last[i] * last[i]);
    return sum;
}

void ssm_gather(const Evaluator *evaluator, long group, const double *z);

#endif
