/* Interior-point method with a barrier that only decreases, Newton steps, and a filter line
 * search.
 *
 * The unknowns x = (c, T) minimise f(x) subject to rows r(x) <= 0 and equalities e(x) = 0. The
 * slacks s > 0 and multipliers lam > 0 belong to the rows, the multipliers nu to the equalities.
 * The barrier problem with weight mu > 0 is
 *
 *     min f(x) - mu sum log s   s.t.  r(x) + s = 0,  e(x) = 0
 *
 * Let Sigma = diag(lam / s). The equations of a Newton step without the slacks and multipliers of
 * the rows, which are eliminated, are (band.c solves them)
 *
 *     (D2(f + lam'r + nu'e) + J' Sigma J) dx + A'(nu + dnu) = -(Df + J'(mu / s + Sigma (r + s))),
 *     A dx = -e
 *     ds = -(r + s) - J dx,   dlam = mu / s - lam - Sigma ds
 *
 * A step reduces s and lam by at most the fraction tau, so they remain positive. A filter accepts
 * or refuses it by the pair (theta, phi): the sum of the absolute residuals, and the barrier
 * function (Waechter and Biegler, Math. Program. 106, 2006, section 2.3). If the filter refuses
 * the whole step, slacks of -r are tried before the step is halved. mu decreases when the largest
 * residual of the barrier problem is at most BARRIER mu (their section 2.1).
 *
 * The result has converged if the dual residual Df + J'lam + A'nu, the primal residuals and s lam
 * are at most `tolerance`, without scaling by the size of the multipliers.
 */

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "interior.h"

static const double PUSH = 1e-2; /* smallest first slack of a cold start */
/* Largest ratio of the multipliers of a warm start to mu / s. 1 / NEAR is the smallest ratio. */
static const double NEAR = 100.0;
static const double BARRIER = 100.0; /* residual of a solved barrier problem, in units of mu */
static const double LINEAR = 0.2;    /* mu becomes the smaller of LINEAR mu and mu^superlinear */
static const double LAST_BARRIER = 11.0; /* ratio of the tolerance to the last mu */
static const double BOUNDARY = 0.995;    /* tau is the larger of this value and 1 - mu */
static const double SHORTER = 0.5;       /* a step reduces a duration by at most this fraction */
/* Largest ratio of the multipliers to mu / s during the iterations. 1 / MULTIPLIERS is
 * the smallest. */
static const double MULTIPLIERS = 1e10;
/* Relative improvement that the filter requires, and share of the predicted decrease of phi. */
static const double MARGIN = 1e-5, ARMIJO = 1e-8;
/* Fraction below which a step is short, and theta below which the residuals count as 0. */
static const double SHORT = 1e-2, SMALL = 1e-10;
static const double WORST = 1e4;   /* no step may reach this multiple of theta at the start */
/* Number of lengths that are tried, and of consecutive refused or short steps that end a solve. */
enum { HALVINGS = 12, REFUSED = 5, PATIENCE = 20 };
/* Largest number of iterations after convergence, which bring s lam closer to mu. */
enum { CENTRING = 3 };

/* Measures of a point: the sum of its absolute residuals, and its barrier function. */
typedef struct {
    double theta, phi;
} Pair;

typedef struct {
    double residuals; /* sum of the absolute residuals of the rows and equalities */
    double logs;      /* sum of the logarithms of the slacks */
} Sums;

/* State of the method. Arrays of rows contain the active rows only. */
typedef struct {
    Evaluator evaluator;
    System system;
    Point points[2];
    Point *current, *trial;
    double mu, tolerance, superlinear;
    /* sigma: lam / slacks. weights: factors of the rows on the right-hand side of a Newton step */
    double *slacks, *trial_slacks, *inverse_slacks, *lam, *sigma, *weights;
    double *slacks_step, *lam_step;
    double residual, least, most; /* largest residual; smallest and largest slack times lam */
    Sums sums;                    /* sums at the current point */
    /* nu: multipliers of the equalities. dual: gradient of the Lagrangian by (c, T). solution:
     * step of (c, T), then the new nu */
    double *nu, *dual, *solution;
    Pair *pairs;                  /* filter: a step must improve theta or phi of each pair */
    long pair_count;
    double worst;
    long refused_steps, short_steps;
} Iteration;

/* Return the larger number, or NaN if one of them is NaN. */
static double maximum_or_nan(double a, double b) { return isnan(a) || a > b ? a : b; }

/* Return the bits of |x| as an integer. They have the order of the numbers, with NaN as the
 * largest. */
static int64_t absolute_bits(double x)
{
    int64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits & INT64_MAX;
}

/* Return the number with these bits. */
static double from_bits(int64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* Return the bits of the largest absolute value of an array. */
static int64_t largest_bits(const double *values, long count)
{
    int64_t most = 0;
    for (long i = 0; i < count; i++)
        most = absolute_bits(values[i]) > most ? absolute_bits(values[i]) : most;
    return most;
}

/* Store the largest residual, and the smallest and largest product s lam, of the current point. */
static void measure_residuals(Iteration *it)
{
    const Evaluator *e = &it->evaluator;
    const double *rows = it->current->rows, *slacks = it->slacks, *lam = it->lam;
    const int64_t dual = largest_bits(it->dual, e->size + e->b),
                  equality = largest_bits(it->current->equal, e->equal_size);
    int64_t residual = dual > equality ? dual : equality, most = 0, least = INT64_MAX;
    for (long i = 0; i < e->active; i++) {
        const int64_t row_residual = absolute_bits(rows[i] + slacks[i]),
                      product = absolute_bits(slacks[i] * lam[i]);
        residual = row_residual > residual ? row_residual : residual;
        most = product > most ? product : most;
        least = product < least ? product : least;
    }
    it->residual = from_bits(residual);
    it->most = from_bits(most);
    it->least = from_bits(least);
}

/* Return the largest residual of the barrier problem with weight mu. */
static double barrier_error(const Iteration *it, double mu)
{
    if (it->evaluator.active == 0) return it->residual;
    return maximum_or_nan(it->residual, maximum_or_nan(it->most - mu, mu - it->least));
}

/* Compute the sums of a point. The logarithm of a product of slacks replaces the sum of their
 * logarithms, which takes more time. The product starts again at 1 before it becomes too small or
 * too large. */
static Sums compute_sums(const Iteration *it, const Point *point, const double *slacks)
{
    enum { LANES = 4 };
    const Evaluator *e = &it->evaluator;
    double residuals[LANES] = {0.0}, product[LANES] = {1.0, 1.0, 1.0, 1.0};
    Sums sums = {0.0, 0.0};
    for (long i = 0; i < e->active; i += LANES) {
        const long count = e->active - i < LANES ? e->active - i : LANES;
        int is_extreme = 0;
        for (long k = 0; k < count; k++) {
            residuals[k] += fabs(point->rows[i + k] + slacks[i + k]);
            product[k] *= slacks[i + k];
            is_extreme |= !(product[k] > 1e-200 && product[k] < 1e200);
        }
        for (long k = 0; is_extreme && k < count; k++) {
            sums.logs += log(product[k] / slacks[i + k]) + log(slacks[i + k]);
            product[k] = 1.0;
        }
    }
    for (long k = 0; k < LANES; k++) {
        sums.logs += log(product[k]);
        sums.residuals += residuals[k];
    }
    for (long i = 0; i < e->equal_size; i++) sums.residuals += fabs(point->equal[i]);
    return sums;
}

/* Return theta and phi of a point with these sums. */
static Pair filter_pair(const Iteration *it, const Point *point, Sums sums)
{
    const Pair pair = {sums.residuals, point->objective - it->mu * sums.logs};
    return pair;
}

/* Return the largest fraction of a step, at most 1, that reduces no value by more than the
 * fraction tau. All values are positive. */
static double largest_step(const double *values, const double *step, long count, double tau)
{
    double fall = 0.0;
    for (long i = 0; i < count; i++) {
        const double share = step[i] / values[i];
        fall = share < fall ? share : fall;
    }
    return fall >= -tau ? 1.0 : -tau / fall;
}

/* Return the value between `least` and `most` that is closest to `value`. */
static double clip(double value, double least, double most)
{
    const double raised = value > least ? value : least;
    return raised < most ? raised : most;
}

/* Compute 1 / s. */
static void invert_slacks(Iteration *it)
{
    for (long i = 0; i < it->evaluator.active; i++) it->inverse_slacks[i] = 1.0 / it->slacks[i];
}

/* Compute the derivatives and residuals at the current point. */
static void differentiate(Iteration *it)
{
    for (long i = 0; i < it->evaluator.active; i++)
        it->sigma[i] = it->lam[i] * it->inverse_slacks[i];
    ssm_differentiate(&it->evaluator, it->current, it->lam, it->sigma);
    ssm_dual(&it->evaluator, it->lam, it->nu, it->dual);
    measure_residuals(it);
}

/* Allocate all arrays. Return 0 if there is not enough memory, otherwise 1. */
static int reserve(Iteration *it)
{
    Evaluator *e = &it->evaluator;
    Memory *memory = &e->memory;
    for (int i = 0; i < 2; i++) {
        it->points[i].c = ssm_doubles(memory, e->size);
        it->points[i].times = ssm_doubles(memory, e->b);
        it->points[i].z = ssm_doubles(memory, e->n * e->states);
        it->points[i].rows = ssm_doubles(memory, e->active);
        it->points[i].equal = ssm_doubles(memory, e->equal_size);
    }
    double **row_arrays[] = {&it->slacks, &it->trial_slacks, &it->inverse_slacks, &it->lam,
                             &it->sigma,  &it->weights,      &it->slacks_step,    &it->lam_step};
    for (size_t i = 0; i < sizeof row_arrays / sizeof *row_arrays; i++)
        *row_arrays[i] = ssm_doubles(memory, e->active);
    it->nu = ssm_doubles(memory, e->equal_size);
    it->dual = ssm_doubles(memory, e->size + e->b);
    it->solution = ssm_doubles(memory, e->size + e->b + e->equal_size);
    return ssm_system_new(&it->system, memory, e->size, e->b + e->equal_size, e->m, e->stride);
}

/* Set the first point, its slacks and its multipliers.
 *
 * warm: 1 if `state` is the result of a similar problem, otherwise 0. barrier: mu of a cold start.
 */
static void initialise(Iteration *it, const State *state, int warm, double barrier)
{
    Evaluator *e = &it->evaluator;
    it->current = it->points;
    it->trial = it->points + 1;
    it->mu = warm ? it->tolerance / LAST_BARRIER : barrier;
    memcpy(it->current->c, state->c, (size_t)e->size * sizeof(double));
    memcpy(it->current->times, state->times, (size_t)e->b * sizeof(double));
    ssm_values(e, it->current);
    for (long i = 0; i < e->active; i++) {
        const double previous_multiplier = warm ? state->multipliers[e->row_index[i]] : 0.0;
        it->slacks[i] = maximum_or_nan(
            -it->current->rows[i],
            previous_multiplier > 0.0 ? fmin(it->mu / previous_multiplier, PUSH) : PUSH);
        it->lam[i] = it->mu / it->slacks[i];
        if (warm) it->lam[i] = clip(previous_multiplier, it->lam[i] / NEAR, it->lam[i] * NEAR);
    }
    for (long i = 0; warm && i < e->equal_size; i++) it->nu[i] = state->equality_multipliers[i];
    it->sums = compute_sums(it, it->current, it->slacks);
    it->worst = WORST * fmax(1.0, it->sums.residuals);
    invert_slacks(it);
    differentiate(it);
}

/* Copy the current point to `state`. */
static void store_result(const Iteration *it, State *state)
{
    const Evaluator *e = &it->evaluator;
    memcpy(state->c, it->current->c, (size_t)e->size * sizeof(double));
    memcpy(state->times, it->current->times, (size_t)e->b * sizeof(double));
    memcpy(state->z, it->current->z, (size_t)(e->n * e->states) * sizeof(double));
    for (long i = 0; i < e->all_rows; i++) {
        state->slacks[i] = 1.0;
        state->multipliers[i] = 0.0;
    }
    for (long i = 0; i < e->active; i++) {
        state->slacks[e->row_index[i]] = it->slacks[i];
        state->multipliers[e->row_index[i]] = it->lam[i];
    }
    for (long i = 0; i < e->equal_size; i++) state->equality_multipliers[i] = it->nu[i];
    state->objective = it->current->objective;
}

/* Decision about a trial point. DESCENT reduces phi sufficiently. PROGRESS improves theta or phi,
 * and the filter receives the previous pair. */
typedef enum { REFUSE, DESCENT, PROGRESS } Verdict;

/* Decide about a trial point with the pair `after`.
 *
 * before: pair of the current point. slope: derivative of phi along the whole step. length:
 * fraction of the step. */
static Verdict judge(const Iteration *it, Pair after, Pair before, double slope, double length)
{
    int admitted = isfinite(after.theta) && isfinite(after.phi) && after.theta < it->worst;
    for (long i = 0; admitted && i < it->pair_count; i++) {
        const Pair *pair = it->pairs + i;
        admitted = after.theta < (1.0 - MARGIN) * pair->theta ||
                   after.phi < pair->phi - MARGIN * pair->theta;
    }
    if (!admitted) return REFUSE;
    if (slope < 0.0 && length * pow(-slope, 2.3) > pow(before.theta, 1.1))
        return after.phi <= before.phi + ARMIJO * length * slope + 1e-13 * fabs(before.phi)
                   ? DESCENT
                   : REFUSE;
    const int better = after.theta <= (1.0 - MARGIN) * before.theta ||
                       after.phi <= before.phi - MARGIN * before.theta;
    return better || after.theta < SMALL ? PROGRESS : REFUSE;
}

/* Evaluate the trial point at a fraction `length` of the step. */
static void move_to_trial(Iteration *it, double length)
{
    const Evaluator *e = &it->evaluator;
    for (long i = 0; i < e->size; i++)
        it->trial->c[i] = it->current->c[i] + length * it->solution[i];
    for (long i = 0; i < e->b; i++)
        it->trial->times[i] = it->current->times[i] + length * it->solution[e->size + i];
    ssm_values(&it->evaluator, it->trial);
}

/* Move to the first trial point that the filter accepts, and return the fraction of the step.
 *
 * Without such a point, move to the last one and clear the filter. slope: derivative of phi along
 * the whole step. length: fraction to try first. tau: see the constant BOUNDARY. */
static double search_line(Iteration *it, double slope, double length, double tau)
{
    const Evaluator *e = &it->evaluator;
    const Pair before = filter_pair(it, it->current, it->sums);
    Sums sums = it->sums;
    Verdict verdict = REFUSE;
    for (int k = 0; k < HALVINGS; k++) {
        move_to_trial(it, length);
        for (long i = 0; i < e->active; i++)
            it->trial_slacks[i] =
                maximum_or_nan(it->slacks[i] + length * it->slacks_step[i], -it->trial->rows[i]);
        sums = compute_sums(it, it->trial, it->trial_slacks);
        verdict = judge(it, filter_pair(it, it->trial, sums), before, slope, length);
        if (verdict == REFUSE && k == 0) {
            for (long i = 0; i < e->active; i++)
                it->trial_slacks[i] =
                    maximum_or_nan(-it->trial->rows[i], (1.0 - tau) * it->slacks[i]);
            sums = compute_sums(it, it->trial, it->trial_slacks);
            verdict = judge(it, filter_pair(it, it->trial, sums), before, slope, length);
        }
        if (verdict != REFUSE || it->evaluator.failed) break;
        if (k < HALVINGS - 1) length /= 2.0;
    }
    if (verdict == PROGRESS) it->pairs[it->pair_count++] = before;
    if (verdict == REFUSE) it->pair_count = 0;
    it->refused_steps = verdict == REFUSE ? it->refused_steps + 1 : 0;
    Point *kept = it->current;
    it->current = it->trial;
    it->trial = kept;
    double *slacks = it->slacks;
    it->slacks = it->trial_slacks;
    it->trial_slacks = slacks;
    it->sums = sums;
    invert_slacks(it);
    return length;
}

/* Compute the Newton step of (c, T) and the new nu. Return 0 if that is impossible, otherwise 1. */
static int newton_step(Iteration *it)
{
    Evaluator *e = &it->evaluator;
    const long unknowns = e->size + e->b;
    for (long i = 0; i < e->active; i++)
        it->weights[i] =
            it->mu * it->inverse_slacks[i] + it->sigma[i] * (it->current->rows[i] + it->slacks[i]);
    ssm_newton_matrix(e, &it->system, it->sigma);
    if (e->failed || !ssm_factorise(&it->system, e->program->is_free, e->b)) return 0;
    ssm_right_side(e, it->weights, it->solution);
    for (long i = 0; i < e->equal_size; i++) it->solution[unknowns + i] = it->current->equal[i];
    ssm_solve_factors(&it->system, it->solution, it->solution + e->size);
    int finite = 1;
    for (long i = 0; i < unknowns + e->equal_size; i++) {
        it->solution[i] = -it->solution[i];
        finite = finite && isfinite(it->solution[i]);
    }
    return finite;
}

/* Return the largest |s lam / mu - 1|. */
static double off_centre(const Iteration *it)
{
    double most = 0.0;
    for (long i = 0; i < it->evaluator.active; i++)
        most = maximum_or_nan(most, fabs(it->slacks[i] * it->lam[i] / it->mu - 1.0));
    return most;
}

/* Do one iteration. Return 0 if the method cannot continue, otherwise 1. */
static int iterate(Iteration *it)
{
    Evaluator *e = &it->evaluator;
    const double least = it->tolerance / LAST_BARRIER;
    const long unknowns = e->size + e->b;
    while (it->mu > least && barrier_error(it, it->mu) <= BARRIER * it->mu) {
        it->mu = fmax(least, fmin(LINEAR * it->mu, pow(it->mu, it->superlinear)));
        it->pair_count = 0;
    }
    if (!newton_step(it)) return 0;
    double slope = ssm_along(e, it->solution, it->solution + e->size, it->slacks_step);
    for (long i = 0; i < e->active; i++) {
        it->slacks_step[i] = -(it->current->rows[i] + it->slacks[i]) - it->slacks_step[i];
        it->lam_step[i] =
            it->mu * it->inverse_slacks[i] - it->lam[i] - it->sigma[i] * it->slacks_step[i];
    }
    slope -= it->mu * ssm_dot(it->slacks_step, it->inverse_slacks, e->active);
    const double tau = fmax(BOUNDARY, 1.0 - it->mu);
    double length = fmin(largest_step(it->slacks, it->slacks_step, e->active, tau),
                         largest_step(it->current->times, it->solution + e->size, e->b, SHORTER));
    length = search_line(it, slope, length, tau);
    if (e->failed) return 0;
    const double dual_length = largest_step(it->lam, it->lam_step, e->active, tau);
    for (long i = 0; i < e->active; i++) {
        const double central = it->mu * it->inverse_slacks[i];
        it->lam[i] = clip(it->lam[i] + dual_length * it->lam_step[i], central / MULTIPLIERS,
                          central * MULTIPLIERS);
    }
    for (long i = 0; i < e->equal_size; i++)
        it->nu[i] += length * (it->solution[unknowns + i] - it->nu[i]);
    differentiate(it);
    it->short_steps = length < SHORT ? it->short_steps + 1 : 0;
    return !e->failed && it->refused_steps < REFUSED && it->short_steps < PATIENCE;
}

/* Find a local minimum, starting from `state`, which receives the result unless memory is
 * exhausted.
 *
 * warm: 1 if `state` is the result of a similar problem, 0 if only its c and times are given.
 * Return one of NOT_CONVERGED, CONVERGED, NO_VALUE and NO_MEMORY. */
SSM_API int ssm_solve(const Program *program, State *state, int warm, const Patience *patience)
{
    Iteration it;
    int converged = NOT_CONVERGED;
    long k = 0;
    memset(&it, 0, sizeof it);
    it.tolerance = patience->tolerance;
    it.superlinear = patience->superlinear;
    if (ssm_evaluator_new(&it.evaluator, program) && reserve(&it))
        it.pairs =
            (Pair *)(void *)ssm_doubles(&it.evaluator.memory, 2 * (patience->iterations + 1));
    if (it.evaluator.memory.failed || it.pairs == NULL) {
        ssm_release(&it.evaluator.memory);
        return NO_MEMORY;
    }
    initialise(&it, state, warm, patience->barrier);
    for (int centring = 0; k < patience->iterations && !it.evaluator.failed; k++) {
        const int is_converged = barrier_error(&it, 0.0) <= it.tolerance;
        if (is_converged && (!(patience->off_centre < off_centre(&it)) || centring++ == CENTRING))
            break;
        if (!iterate(&it)) break;
    }
    if (!it.evaluator.failed && barrier_error(&it, 0.0) <= it.tolerance) converged = CONVERGED;
    store_result(&it, state);
    state->iterations = k;
    ssm_release(&it.evaluator.memory);
    return it.evaluator.failed ? NO_VALUE : converged;
}
