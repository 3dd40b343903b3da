/* Functions that program.c (values) and derivatives.c share. */

#ifndef SSM_PROGRAM_H
#define SSM_PROGRAM_H

#include "interior.h"

/* Make a call with the constant `m` equal to the number of coordinates, so that the compiler knows
 * the length of each loop over them. */
#define FOR_COORDINATES(count, call)                             \
    switch (count) {                                             \
    case 1: { enum { m = 1 }; call; break; }                     \
    case 2: { enum { m = 2 }; call; break; }                     \
    case 3: { enum { m = 3 }; call; break; }                     \
    case COORDINATES: { enum { m = COORDINATES }; call; break; } \
    }

/* Return the index in z of the first coordinate of row o of M. The duration h precedes the last
 * row. */
static inline long state_index(long o, long m) { return o * m + (o == LOCAL); }

/* Return the sum of `count` values. */
static inline double sum_values(const double *values, long count)
{
    double sum = 0.0;
    for (long i = 0; i < count; i++) sum += values[i];
    return sum;
}

/* Return the stretch s = sum T / S_0, or 1 if the unknowns contain the velocity itself. */
static inline double compute_stretch(const Evaluator *e, const double *times)
{
    const double reference_duration = e->program->stretched_from;
    return reference_duration > 0.0 ? sum_values(times, e->b) / reference_duration : 1.0;
}

/* Compute the lengths eta of element k from the durations T of the blocks. Lengths beyond the ends
 * are 0. */
static inline void compute_lengths(const Evaluator *e, const double *times, double stretch, long k,
                                   double eta[WIDEST])
{
    const Program *p = e->program;
    if (e->kind == HERMITE) {
        eta[0] = p->fractions[k] * times[p->block[k]];
        eta[1] = stretch;
        return;
    }
    for (long j = 0; j < WIDEST; j++) {
        const long neighbour = k + j - 2;
        eta[j] = neighbour < 0 || neighbour >= e->n
                     ? 0.0
                     : p->fractions[neighbour] * times[p->block[neighbour]];
    }
}

/* Return row l of A z. */
static inline double linear_value(const Evaluator *e, long l, const double *z)
{
    double sum = 0.0;
    for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++)
        sum += e->a_value[a] * z[e->a_column[a]];
    return sum;
}

/* Return the derivative of e var(T / l) by T_i, which is e 2 / b (T_i / l_i - mean of T / l) / l_i.
 * l are the smallest durations T_least. */
static inline double variance_slope(const Evaluator *e, const double *times, long i)
{
    const double *least = e->program->least_times, b = (double)e->b;
    double mean = 0.0;
    if (e->program->even == 0.0) return 0.0;
    for (long j = 0; j < e->b; j++) mean += times[j] / least[j] / b;
    return 2.0 * e->program->even / b * (times[i] / least[i] - mean) / least[i];
}

/* Return sum_i p_i (a_0^2 + a_0 a_1 + a_1^2)_i of an element, with u'' = a_0 and a_1 at its ends.
 */
static inline double smoothing(const Evaluator *e, const double *z)
{
    const double *first = z + 2 * e->m, *last = z + 3 * e->m;
    double sum = 0.0;
    for (long i = 0; i < e->m; i++)
        sum += e->program->smoothing[i] *
               (first[i] * first[i] + first[i] * last[i] + last[i] * last[i]);
    return sum;
}

/* Copy z of the elements of a group to the arguments of its functions. */
void ssm_gather(const Evaluator *evaluator, long group, const double *z);

#endif
