/* The interior point: a monotone barrier, Newton steps on a small positive definite band, a filter line search.
 *
 * With slacks s > 0 of the rows r(x) + s = 0 and multipliers lam > 0, of equalities e(x) = 0 and nu, the barrier problem of mu is
 *
 *     min f(x) - mu sum log s   s.t.  r(x) + s = 0,  e(x) = 0
 *
 * Its Newton step has, with Sigma = diag(lam / s), the slacks and multipliers of rows eliminated (band.c):
 *
 *     (D2(f + lam'r + nu'e) + J' Sigma J) dx + A'(nu + dnu) = -(Df + J'(mu / s + Sigma (r + s))),   A dx = -e
 *     ds = -(r + s) - J dx,   dlam = mu / s - lam - Sigma ds
 *
 * Steps keep s and lam positive (fraction to the boundary tau) and are accepted by a filter on (theta, phi), the sum of the
 * residuals and the barrier function (Waechter and Biegler, Math. Program. 106, 2006, section 2.3); where the whole step is
 * refused, slacks set to -r are tried before it is halved. mu falls when the barrier problem is solved to BARRIER mu (their
 * section 2.1).
 *
 * Converged is where dual residual Df + J'lam + A'nu, primal residual and s lam are all at most `tolerance`, as they stand,
 * without scaling by the size of the multipliers. The constants are those of ssm_planner/interior/solve.py.
 */

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "interior.h"

static const double PUSH = 1e-2;                          /* least first slack of a cold start */
static const double NEAR = 100.0;                         /* by which multipliers of a warm start may be off mu / s */
static const double BARRIER = 100.0;                      /* a barrier problem is solved to this many mu */
static const double LINEAR = 0.2;                         /* mu becomes the least of LINEAR mu and mu^superlinear */
static const double LAST_BARRIER = 11.0;                  /* tolerance in the last mu */
static const double BOUNDARY = 0.995;                     /* tau: fraction to the boundary, 1 - mu later */
static const double SHORTER = 0.5;                        /* a step keeps this share of every time */
static const double MULTIPLIERS = 1e10;                   /* largest factor of multipliers off mu / s */
static const double MARGIN = 1e-5, ARMIJO = 1e-8;         /* of the filter, and of sufficient decrease */
static const double SHORT = 1e-2, SMALL = 1e-10;          /* share of a step that is a short one; theta that is none */
static const double WORST = 1e4;                          /* theta in that of the start which no step may reach */
enum { HALVINGS = 12, REFUSED = 5, PATIENCE = 20 };       /* of a step; steps in a row that are refused, or short */
enum { CENTRING = 3 };                                    /* most iterations after the last one that was needed */

typedef struct {
    double theta, phi;
} Pair;

typedef struct { /* of the absolute residuals of the rows and equalities, of the logarithms of the slacks */
    double residuals, logs;
} Sums;

typedef struct {
    Evaluator evaluator;
    System system;
    Place places[2];
    Place *now, *trial;
    double mu, tolerance, superlinear;
    double *slacks, *tried, *over, *lam, *sigma, *weights; /* of the rows that count; over: 1 / slacks */
    double *slacks_step, *lam_step;
    double residual, least, most; /* largest of the dual and primal residuals; bounds of slacks times lam */
    Sums sums;                    /* at the point */
    double *nu, *dual, *found; /* found: step of (c, T), then nu */
    Pair *pairs;               /* of the filter: no step may be worse than one of them */
    long pair_count;
    double worst;
    long refused, brief;
} Iteration;

static double larger(double a, double b) /* not a number where one is none */
{
    return isnan(a) || a > b ? a : b;
}

/* |x| as an integer: these are in the order of the numbers, and what is none is the largest */
static int64_t size_of(double x)
{
    int64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits & INT64_MAX;
}

static double of_size(int64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static int64_t largest(const double *values, long count)
{
    int64_t most = 0;
    for (long i = 0; i < count; i++)
        most = size_of(values[i]) > most ? size_of(values[i]) : most;
    return most;
}

/* what error_of needs of the point */
static void measure(Iteration *it)
{
    const Evaluator *e = &it->evaluator;
    const double *rows = it->now->rows, *slacks = it->slacks, *lam = it->lam;
    const int64_t dual = largest(it->dual, e->size + e->b), equal = largest(it->now->equal, e->equal_size);
    int64_t residual = dual > equal ? dual : equal, most = 0, least = INT64_MAX;
    for (long i = 0; i < e->active; i++) {
        const int64_t of_row = size_of(rows[i] + slacks[i]), product = size_of(slacks[i] * lam[i]);
        residual = of_row > residual ? of_row : residual;
        most = product > most ? product : most;
        least = product < least ? product : least;
    }
    it->residual = of_size(residual);
    it->most = of_size(most);
    it->least = of_size(least);
}

/* largest residual of the barrier problem of mu */
static double error_of(const Iteration *it, double mu)
{
    if (it->evaluator.active == 0)
        return it->residual;
    return larger(it->residual, larger(it->most - mu, mu - it->least));
}

/* the logarithms of products take less time than their sum */
static Sums sums_of(const Iteration *it, const Place *place, const double *slacks)
{
    enum { LANES = 4 };
    const Evaluator *e = &it->evaluator;
    double residuals[LANES] = {0.0}, product[LANES] = {1.0, 1.0, 1.0, 1.0};
    Sums sums = {0.0, 0.0};
    for (long i = 0; i < e->active; i += LANES) {
        const long count = e->active - i < LANES ? e->active - i : LANES;
        int beyond = 0;
        for (long k = 0; k < count; k++) {
            residuals[k] += fabs(place->rows[i + k] + slacks[i + k]);
            product[k] *= slacks[i + k];
            beyond |= !(product[k] > 1e-200 && product[k] < 1e200);
        }
        for (long k = 0; beyond && k < count; k++) {
            sums.logs += log(product[k] / slacks[i + k]) + log(slacks[i + k]);
            product[k] = 1.0;
        }
    }
    for (long k = 0; k < LANES; k++) {
        sums.logs += log(product[k]);
        sums.residuals += residuals[k];
    }
    for (long i = 0; i < e->equal_size; i++)
        sums.residuals += fabs(place->equal[i]);
    return sums;
}

/* sum of the residuals, and the barrier function */
static Pair pair_of(const Iteration *it, const Place *place, Sums sums)
{
    const Pair found = {sums.residuals, place->objective - it->mu * sums.logs};
    return found;
}

/* largest share of a step, at most 1, that keeps 1 - tau of positive values */
static double longest(const double *values, const double *step, long count, double tau)
{
    double fall = 0.0;
    for (long i = 0; i < count; i++) {
        const double share = step[i] / values[i];
        fall = share < fall ? share : fall;
    }
    return fall >= -tau ? 1.0 : -tau / fall;
}

static double clipped(double value, double least, double most)
{
    const double raised = value > least ? value : least;
    return raised < most ? raised : most;
}

static void invert_slacks(Iteration *it)
{
    for (long i = 0; i < it->evaluator.active; i++)
        it->over[i] = 1.0 / it->slacks[i];
}

/* gradients at the point */
static void differentiate(Iteration *it)
{
    for (long i = 0; i < it->evaluator.active; i++)
        it->sigma[i] = it->lam[i] * it->over[i];
    ssm_differentiate(&it->evaluator, it->now, it->lam, it->sigma);
    ssm_dual(&it->evaluator, it->lam, it->nu, it->dual);
    measure(it);
}

static int reserve(Iteration *it)
{
    Evaluator *e = &it->evaluator;
    Memory *memory = &e->memory;
    for (int i = 0; i < 2; i++) {
        it->places[i].c = ssm_doubles(memory, e->size);
        it->places[i].times = ssm_doubles(memory, e->b);
        it->places[i].z = ssm_doubles(memory, e->n * e->states);
        it->places[i].rows = ssm_doubles(memory, e->active);
        it->places[i].equal = ssm_doubles(memory, e->equal_size);
    }
    double **of_rows[] = {&it->slacks, &it->tried,   &it->over,        &it->lam,
                          &it->sigma,  &it->weights, &it->slacks_step, &it->lam_step};
    for (size_t i = 0; i < sizeof of_rows / sizeof *of_rows; i++)
        *of_rows[i] = ssm_doubles(memory, e->active);
    it->nu = ssm_doubles(memory, e->equal_size);
    it->dual = ssm_doubles(memory, e->size + e->b);
    it->found = ssm_doubles(memory, e->size + e->b + e->equal_size);
    return ssm_system_new(&it->system, memory, e->size, e->b + e->equal_size, e->m, e->stride);
}

static void begin(Iteration *it, const State *state, int warm, double barrier)
{
    Evaluator *e = &it->evaluator;
    it->now = it->places;
    it->trial = it->places + 1;
    it->mu = warm ? it->tolerance / LAST_BARRIER : barrier;
    memcpy(it->now->c, state->c, (size_t)e->size * sizeof(double));
    memcpy(it->now->times, state->times, (size_t)e->b * sizeof(double));
    ssm_values(e, it->now);
    for (long i = 0; i < e->active; i++) {
        const double known = warm ? state->multipliers[e->place_of[i]] : 0.0;
        it->slacks[i] = larger(-it->now->rows[i], known > 0.0 ? fmin(it->mu / known, PUSH) : PUSH);
        it->lam[i] = it->mu / it->slacks[i];
        if (warm)
            it->lam[i] = clipped(known, it->lam[i] / NEAR, it->lam[i] * NEAR);
    }
    for (long i = 0; warm && i < e->equal_size; i++)
        it->nu[i] = state->equality_multipliers[i];
    it->sums = sums_of(it, it->now, it->slacks);
    it->worst = WORST * fmax(1.0, it->sums.residuals);
    invert_slacks(it);
    differentiate(it);
}

static void finish(const Iteration *it, State *state)
{
    const Evaluator *e = &it->evaluator;
    memcpy(state->c, it->now->c, (size_t)e->size * sizeof(double));
    memcpy(state->times, it->now->times, (size_t)e->b * sizeof(double));
    memcpy(state->z, it->now->z, (size_t)(e->n * e->states) * sizeof(double));
    for (long i = 0; i < e->all_rows; i++) {
        state->slacks[i] = 1.0;
        state->multipliers[i] = 0.0;
    }
    for (long i = 0; i < e->active; i++) {
        state->slacks[e->place_of[i]] = it->slacks[i];
        state->multipliers[e->place_of[i]] = it->lam[i];
    }
    for (long i = 0; i < e->equal_size; i++)
        state->equality_multipliers[i] = it->nu[i];
    state->objective = it->now->objective;
}

typedef enum { REFUSE, DESCENT, PROGRESS } Verdict; /* progress enters the filter */

static Verdict judge(const Iteration *it, Pair after, Pair before, double slope, double length)
{
    int admitted = isfinite(after.theta) && isfinite(after.phi) && after.theta < it->worst;
    for (long i = 0; admitted && i < it->pair_count; i++) {
        const Pair *pair = it->pairs + i;
        admitted = after.theta < (1.0 - MARGIN) * pair->theta || after.phi < pair->phi - MARGIN * pair->theta;
    }
    if (!admitted)
        return REFUSE;
    if (slope < 0.0 && length * pow(-slope, 2.3) > pow(before.theta, 1.1))
        return after.phi <= before.phi + ARMIJO * length * slope + 1e-13 * fabs(before.phi) ? DESCENT : REFUSE;
    const int better = after.theta <= (1.0 - MARGIN) * before.theta || after.phi <= before.phi - MARGIN * before.theta;
    return better || after.theta < SMALL ? PROGRESS : REFUSE;
}

static void move_to_trial(Iteration *it, double length)
{
    const Evaluator *e = &it->evaluator;
    for (long i = 0; i < e->size; i++)
        it->trial->c[i] = it->now->c[i] + length * it->found[i];
    for (long i = 0; i < e->b; i++)
        it->trial->times[i] = it->now->times[i] + length * it->found[e->size + i];
    ssm_values(&it->evaluator, it->trial);
}

/* go along the step as far as the filter lets, and return how far that was; a short way where it refuses everything */
static double search(Iteration *it, double slope, double length, double tau)
{
    const Evaluator *e = &it->evaluator;
    const Pair before = pair_of(it, it->now, it->sums);
    Sums sums = it->sums;
    Verdict verdict = REFUSE;
    for (int k = 0; k < HALVINGS; k++) {
        move_to_trial(it, length);
        for (long i = 0; i < e->active; i++)
            it->tried[i] = larger(it->slacks[i] + length * it->slacks_step[i], -it->trial->rows[i]);
        sums = sums_of(it, it->trial, it->tried);
        verdict = judge(it, pair_of(it, it->trial, sums), before, slope, length);
        if (verdict == REFUSE && k == 0) {
            for (long i = 0; i < e->active; i++)
                it->tried[i] = larger(-it->trial->rows[i], (1.0 - tau) * it->slacks[i]);
            sums = sums_of(it, it->trial, it->tried);
            verdict = judge(it, pair_of(it, it->trial, sums), before, slope, length);
        }
        if (verdict != REFUSE || it->evaluator.failed)
            break;
        if (k < HALVINGS - 1)
            length /= 2.0;
    }
    if (verdict == PROGRESS)
        it->pairs[it->pair_count++] = before;
    if (verdict == REFUSE)
        it->pair_count = 0;
    it->refused = verdict == REFUSE ? it->refused + 1 : 0;
    Place *kept = it->now;
    it->now = it->trial;
    it->trial = kept;
    double *slacks = it->slacks;
    it->slacks = it->tried;
    it->tried = slacks;
    it->sums = sums;
    invert_slacks(it);
    return length;
}

/* found becomes the Newton step of (c, T) and the new nu; 0 where there is none */
static int newton_step(Iteration *it)
{
    Evaluator *e = &it->evaluator;
    const long unknowns = e->size + e->b;
    for (long i = 0; i < e->active; i++)
        it->weights[i] = it->mu * it->over[i] + it->sigma[i] * (it->now->rows[i] + it->slacks[i]);
    ssm_newton_matrix(e, &it->system, it->sigma);
    if (e->failed || !ssm_factorise(&it->system, e->program->is_free, e->b))
        return 0;
    ssm_right_side(e, it->weights, it->found);
    for (long i = 0; i < e->equal_size; i++)
        it->found[unknowns + i] = it->now->equal[i];
    ssm_solve_factors(&it->system, it->found, it->found + e->size);
    int finite = 1;
    for (long i = 0; i < unknowns + e->equal_size; i++) {
        it->found[i] = -it->found[i];
        finite = finite && isfinite(it->found[i]);
    }
    return finite;
}

/* largest share by which s lam is off mu */
static double off_centre(const Iteration *it)
{
    double most = 0.0;
    for (long i = 0; i < it->evaluator.active; i++)
        most = larger(most, fabs(it->slacks[i] * it->lam[i] / it->mu - 1.0));
    return most;
}

/* one iteration; 0 where there is no step to take */
static int step(Iteration *it)
{
    Evaluator *e = &it->evaluator;
    const double least = it->tolerance / LAST_BARRIER;
    const long unknowns = e->size + e->b;
    while (it->mu > least && error_of(it, it->mu) <= BARRIER * it->mu) {
        it->mu = fmax(least, fmin(LINEAR * it->mu, pow(it->mu, it->superlinear)));
        it->pair_count = 0;
    }
    if (!newton_step(it))
        return 0;
    double slope = ssm_along(e, it->found, it->found + e->size, it->slacks_step);
    for (long i = 0; i < e->active; i++) {
        it->slacks_step[i] = -(it->now->rows[i] + it->slacks[i]) - it->slacks_step[i];
        it->lam_step[i] = it->mu * it->over[i] - it->lam[i] - it->sigma[i] * it->slacks_step[i];
    }
    slope -= it->mu * ssm_dot(it->slacks_step, it->over, e->active);
    const double tau = fmax(BOUNDARY, 1.0 - it->mu);
    double length = fmin(longest(it->slacks, it->slacks_step, e->active, tau),
                         longest(it->now->times, it->found + e->size, e->b, SHORTER));
    length = search(it, slope, length, tau);
    if (e->failed)
        return 0;
    const double dual_length = longest(it->lam, it->lam_step, e->active, tau);
    for (long i = 0; i < e->active; i++) {
        const double central = it->mu * it->over[i];
        it->lam[i] = clipped(it->lam[i] + dual_length * it->lam_step[i], central / MULTIPLIERS, central * MULTIPLIERS);
    }
    for (long i = 0; i < e->equal_size; i++)
        it->nu[i] += length * (it->found[unknowns + i] - it->nu[i]);
    differentiate(it);
    it->brief = length < SHORT ? it->brief + 1 : 0;
    return !e->failed && it->refused < REFUSED && it->brief < PATIENCE;
}

/* A local minimum from state's (c, T), or, warm, from where the solve of a neighbour ended: NOT_CONVERGED, CONVERGED, NO_VALUE
 * where a function gave none, NO_MEMORY. state becomes where it ended, except without memory. */
SSM_API int ssm_solve(const Program *program, State *state, int warm, const Patience *patience)
{
    Iteration it;
    int converged = NOT_CONVERGED;
    long k = 0;
    memset(&it, 0, sizeof it);
    it.tolerance = patience->tolerance;
    it.superlinear = patience->superlinear;
    if (ssm_evaluator_new(&it.evaluator, program) && reserve(&it))
        it.pairs = (Pair *)(void *)ssm_doubles(&it.evaluator.memory, 2 * (patience->iterations + 1));
    if (it.evaluator.memory.failed || it.pairs == NULL) {
        ssm_release(&it.evaluator.memory);
        return NO_MEMORY;
    }
    begin(&it, state, warm, patience->barrier);
    for (int centring = 0; k < patience->iterations && !it.evaluator.failed; k++) {
        const int enough = error_of(&it, 0.0) <= it.tolerance;
        if (enough && (!(patience->off_centre < off_centre(&it)) || centring++ == CENTRING))
            break;
        if (!step(&it))
            break;
    }
    if (!it.evaluator.failed && error_of(&it, 0.0) <= it.tolerance)
        converged = CONVERGED;
    finish(&it, state);
    state->iterations = k;
    ssm_release(&it.evaluator.memory);
    return it.evaluator.failed ? NO_VALUE : converged;
}
