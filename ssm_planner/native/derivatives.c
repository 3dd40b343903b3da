/* First and second derivatives of a program (program.c) at one point.
 *
 * Everything is differentiated by z first and brought to the unknowns of an element by one congruence: to c_f .. c_{f+3} by
 * M x I_m, whose M is the same for every coordinate and never multiplied out, and by dz / dtau to the few times tau on which
 * the lengths of the element depend, most often one.
 */

#include <string.h>

#include "program.h"

static const double STIFF = 1e3; /* of the springs that hold what equalities give: without them K is nearly singular there */

/* ---- first derivatives */

/* (M x I)' of a gradient by z */
static ALWAYS_INLINE void mapped_back(const double *map, const double *by_z, double *by_c, long m)
{
    for (long j = 0; j < LOCAL; j++)
        for (long i = 0; i < m; i++) {
            double sum = 0.0;
            for (long o = 0; o < GIVEN; o++)
                sum += map[o * LOCAL + j] * by_z[entry(o, m) + i];
            by_c[j * m + i] = sum;
        }
}

/* (M x I) c: entries of z but its length */
static ALWAYS_INLINE void mapped(const double *map, const double *c, double *z, long m)
{
    for (long o = 0; o < GIVEN; o++)
        for (long i = 0; i < m; i++)
            z[entry(o, m) + i] = map[o * LOCAL] * c[i] + map[o * LOCAL + 1] * c[m + i] + map[o * LOCAL + 2] * c[2 * m + i] +
                                 map[o * LOCAL + 3] * c[3 * m + i];
}

/* M, and dM / dtau and dz / dtau of its times */
static ALWAYS_INLINE void maps_of(Evaluator *e, const Place *place, long k, long m)
{
    const Lengths *lengths = e->lengths + k;
    double eta[WIDEST], slope[TERMS][WIDEST];
    eta_of(e, place->times, e->stretch, k, eta);
    ssm_matrix(e->kind, eta, (double(*)[LOCAL])(e->maps + k * GIVEN * LOCAL));
    ssm_term_slopes(e->kind, eta, slope);
    for (long x = 0; x < lengths->count; x++) {
        double *of = e->map_slopes + (lengths->first + x) * GIVEN * LOCAL;
        double *by_time = e->by_time + (lengths->first + x) * (GIVEN * m + 1);
        memset(of, 0, GIVEN * LOCAL * sizeof(double));
        for (long t = 0; t < e->terms; t++) {
            double share = 0.0;
            for (long j = 0; j < e->w; j++)
                share += lengths->of[j] == x ? lengths->share[j] * slope[t][j] : 0.0;
            for (long j = 0; j < LOCAL; j++)
                of[e->term[t].given * LOCAL + j] += share * e->term[t].row[j];
        }
        mapped(of, place->c + k * e->stride * m, by_time, m);
        by_time[LOCAL * m] = lengths->of[e->own] == x ? lengths->share[e->own] : 0.0;
    }
}

static ALWAYS_INLINE void differentiate_elements(Evaluator *e, const Place *place, long m)
{
    const double *weight = e->program->smoothing;
    for (long k = 0; k < e->n; k++) {
        const double *z = place->z + k * (GIVEN * m + 1), h = z[LOCAL * m];
        double *by_z = e->cost_by_z + k * (GIVEN * m + 1);
        maps_of(e, place, k, m);
        memset(by_z, 0, (size_t)(GIVEN * m + 1) * sizeof(double));
        for (long i = 0; i < m; i++) {
            by_z[2 * m + i] = h * weight[i] * (2.0 * z[2 * m + i] + z[3 * m + i]);
            by_z[3 * m + i] = h * weight[i] * (2.0 * z[3 * m + i] + z[2 * m + i]);
        }
        by_z[LOCAL * m] = smoothing(e, z);
    }
}

/* choose the point of the derivatives; of the second ones lam and sigma too */
void ssm_differentiate(Evaluator *e, const Place *place, const double *lam, const double *sigma)
{
    const Program *p = e->program;
    e->at = place;
    e->stretch = stretch_of(e, place->times);
    FOR_COORDINATES(e->m, differentiate_elements(e, place, m))
    for (long g = 0; g < p->group_count; g++) {
        const RowGroup *group = p->groups + g;
        const ElementGroup *f = &group->functions;
        Part *part = e->parts + g;
        ssm_gather(e, g, place->z);
        for (long at = 0; at < part->count; at++)
            for (long a = part->first[at]; a < part->first[at + 1]; a++) {
                part->multipliers[at * (f->rows + f->costs) + e->column[a]] = lam[a];
                part->stiffness[at * f->rows + e->column[a]] = sigma[a];
            }
        const Derivatives found = {part->jacobian, part->cost, part->hessian};
        e->failed |= f->derivatives_of(f->context, part->z, part->multipliers, part->stiffness, &found);
        for (long at = 0; at < part->count && f->costs; at++)
            for (long i = 0; i < f->size_z; i++)
                e->cost_by_z[group->elements[at] * e->states + i] += group->cost_weight * part->cost[at * f->size_z + i];
    }
}

/* by_z: of the objective and J' weights of the rows, and of the equalities with `springs` times `equal` */
static ALWAYS_INLINE void slope_by_z(const Evaluator *e, const double *weights, const double *equal, double springs,
                                     double *by_z, long m)
{
    const Program *p = e->program;
    const long size = LOCAL * m + 1, states = GIVEN * m + 1;
    memcpy(by_z, e->cost_by_z, (size_t)(e->n * states) * sizeof(double));
    for (long g = 0; g < p->group_count; g++) {
        const Part *part = e->parts + g;
        const long rows = p->groups[g].functions.rows;
        for (long at = 0; at < part->count; at++) {
            double *of = by_z + p->groups[g].elements[at] * states, sum[LOCAL * COORDINATES + 1];
            memcpy(sum, of, (size_t)size * sizeof(double));
            for (long a = part->first[at]; a < part->first[at + 1]; a++) {
                const double *row = part->jacobian + (at * rows + e->column[a]) * size;
                for (long i = 0; i < size; i++)
                    sum[i] += weights[a] * row[i];
            }
            memcpy(of, sum, (size_t)size * sizeof(double));
        }
    }
    const Part *linear = e->parts + p->group_count;
    for (long k = 0; k < e->n; k++)
        for (long r = linear->first[k]; r < linear->first[k + 1]; r++) {
            const long l = e->column[r];
            for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++)
                by_z[k * states + e->a_column[a]] += weights[r] * e->scale[r] * e->a_value[a];
        }
    for (long q = 0; q < p->equal_count; q++)
        by_z[p->equal_at[q] * states + p->equal_entry[q]] += springs * equal[q];
}

/* a slope by the elements as one by the unknowns (c, T), that of the rows of times with these weights included */
static ALWAYS_INLINE void pull(const Evaluator *e, const double *by_z, const double *weights, double *found, long m)
{
    const Program *p = e->program;
    const long states = GIVEN * m + 1;
    double *by_t = found + e->size, of_all = p->time_weight;
    memset(found, 0, (size_t)(e->size + e->b) * sizeof(double));
    for (long k = 0; k < e->n; k++) {
        const Lengths *lengths = e->lengths + k;
        const double *slope = by_z + k * states, *map = e->maps + k * GIVEN * LOCAL;
        double *of_c = found + k * e->stride * m, by_c[LOCAL * COORDINATES];
        mapped_back(map, slope, by_c, m);
        for (long i = 0; i < LOCAL * m; i++)
            of_c[i] += by_c[i];
        for (long x = 0; x < lengths->count; x++) {
            const double of_time = ssm_dot(e->by_time + (lengths->first + x) * states, slope, states);
            *(lengths->time[x] < e->b ? by_t + lengths->time[x] : &of_all) += of_time;
        }
    }
    for (long i = 0; i < e->size; i++)
        if (!p->is_free[i])
            found[i] = 0.0;
    const double *times = weights + e->first_time;
    for (long t = 0; t < e->total_count; t++)
        of_all += e->totals[t] * times[e->b + t];
    for (long j = 0; j < e->b; j++)
        by_t[j] += of_all + evenness_slope(e, e->at->times, j) - times[j] / p->least_times[j];
}

static ALWAYS_INLINE void gradient(const Evaluator *e, const double *weights, const double *equal, double springs, double *by_z,
                                   double *found, long m)
{
    slope_by_z(e, weights, equal, springs, by_z, m);
    pull(e, by_z, weights, found, m);
}

/* gradient of f + lam' rows + nu' equalities, (size + b) */
void ssm_dual(Evaluator *e, const double *lam, const double *nu, double *dual)
{
    FOR_COORDINATES(e->m, gradient(e, lam, nu, 1.0, e->dual_by_z, dual, m))
    if (e->equal_size > e->program->equal_count)
        for (long j = 0; j < e->b; j++)
            dual[e->size + j] += nu[e->program->equal_count];
}

/* gradient of f + J' weights + STIFF A' e: with it on the right-hand side the step is as without STIFF A' A in the matrix */
void ssm_right_side(Evaluator *e, const double *weights, double *right)
{
    FOR_COORDINATES(e->m, gradient(e, weights, e->at->equal, STIFF, e->by_z, right, m))
}

/* change of the elements along a step, and that of the rows; returns that of f by the elements */
static ALWAYS_INLINE double along(const Evaluator *e, const double *dc, const double *dt, double *all_dz, double *change, long m)
{
    const Program *p = e->program;
    const long size = LOCAL * m + 1, states = GIVEN * m + 1;
    const double sum = total(dt, e->b);
    double slope = 0.0;
    for (long k = 0; k < e->n; k++) {
        const Lengths *lengths = e->lengths + k;
        double *dz = all_dz + k * states;
        mapped(e->maps + k * GIVEN * LOCAL, dc + k * e->stride * m, dz, m);
        dz[LOCAL * m] = 0.0;
        for (long x = 0; x < lengths->count; x++) {
            const double *by_time = e->by_time + (lengths->first + x) * states;
            const double step = lengths->time[x] < e->b ? dt[lengths->time[x]] : sum;
            for (long i = 0; i < states; i++)
                dz[i] += by_time[i] * step;
        }
        slope += ssm_dot(e->cost_by_z + k * states, dz, states);
    }
    for (long g = 0; g < p->group_count; g++) {
        const Part *part = e->parts + g;
        const long rows = p->groups[g].functions.rows;
        for (long at = 0; at < part->count; at++) {
            const double *dz = all_dz + p->groups[g].elements[at] * states;
            for (long a = part->first[at]; a < part->first[at + 1]; a++)
                change[a] = ssm_dot(part->jacobian + (at * rows + e->column[a]) * size, dz, size);
        }
    }
    return slope;
}

/* change of the rows along a step; returns that of f */
double ssm_along(Evaluator *e, const double *dc, const double *dt, double *change)
{
    const Program *p = e->program;
    double slope = 0.0, *dz = e->by_z; /* free here */
    FOR_COORDINATES(e->m, slope = along(e, dc, dt, dz, change, m))
    const Part *linear = e->parts + p->group_count;
    for (long k = 0; k < e->n; k++)
        for (long a = linear->first[k]; a < linear->first[k + 1]; a++)
            change[a] = linear_value(e, e->column[a], dz + k * e->states) * e->scale[a];
    const double sum = total(dt, e->b);
    for (long j = 0; j < e->b; j++) {
        change[e->first_time + j] = -dt[j] / p->least_times[j];
        slope += (p->time_weight + evenness_slope(e, e->at->times, j)) * dt[j];
    }
    for (long t = 0; t < e->total_count; t++)
        change[e->first_time + e->b + t] = e->totals[t] * sum;
    return slope;
}

/* ---- second derivatives */

/* h, whole: of f + lam' rows + J' diag(sigma) J + STIFF A' A, by the entries of element k */
static ALWAYS_INLINE void hessian_by_z(const Evaluator *e, long k, const double *sigma, double *h, long m)
{
    const Program *p = e->program;
    const long size = GIVEN * m + 1, width = LOCAL * m + 1;
    const double *z = e->at->z + k * size;
    memset(h, 0, (size_t)(size * size) * sizeof(double));
    for (long i = 0; i < m; i++) {
        const double weight = p->smoothing[i], length = z[LOCAL * m];
        const long first = 2 * m + i, last = 3 * m + i, own = LOCAL * m;
        h[first * size + first] = h[last * size + last] = 2.0 * weight * length;
        h[last * size + first] = h[first * size + last] = weight * length;
        h[own * size + first] = h[first * size + own] = weight * (2.0 * z[first] + z[last]);
        h[own * size + last] = h[last * size + own] = weight * (2.0 * z[last] + z[first]);
    }
    const Part *linear = e->parts + p->group_count;
    for (long r = linear->first[k]; r < linear->first[k + 1]; r++) {
        const long l = e->column[r];
        const double weight = sigma[r] * e->scale[r] * e->scale[r];
        for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++)
            for (long b = e->a_first[l]; b < e->a_first[l + 1]; b++)
                h[e->a_column[a] * size + e->a_column[b]] += weight * e->a_value[a] * e->a_value[b];
    }
    for (long q = 0; q < p->equal_count; q++)
        if (p->equal_at[q] == k)
            h[p->equal_entry[q] * size + p->equal_entry[q]] += STIFF;
    for (long g = 0; g < p->group_count; g++) {
        const Part *part = e->parts + g;
        for (long of = part->member_at[k]; of < part->member_at[k + 1]; of++) {
            const double *own = part->hessian + part->member[of] * width * width;
            for (long i = 0; i < width; i++)
                for (long j = 0; j < width; j++)
                    h[i * size + j] += own[i * width + j];
        }
    }
}

/* add (M x I)' h (M x I) of element k to the band, column by column; above the diagonal of a panel anything may stand */
static ALWAYS_INLINE void add_to_band(const Evaluator *e, System *system, long k, const double *h, long m)
{
    const long size = GIVEN * m + 1, stride = e->stride, high = LOCAL * m;
    const double *map = e->maps + k * GIVEN * LOCAL;
    const unsigned char *is_free = e->program->is_free + k * stride * m;
    const int all_free = memchr(is_free, 0, (size_t)high) == NULL;
    double *band = system->band + k * stride * m * high;
    for (long i = 0; i < m; i++) {
        double half[GIVEN][LOCAL * COORDINATES]; /* h (M x I), rows of coordinate i */
        for (long o = 0; o < GIVEN; o++)
            mapped_back(map, h + (entry(o, m) + i) * size, half[o], m);
        for (long l = 0; l < LOCAL; l++) {
            const long column = l * m + i, panel = l / stride * stride * m;
            double sum[LOCAL * COORDINATES] = {0.0};
            for (long o = 0; o < GIVEN; o++)
                for (long row = 0; row < high; row++)
                    sum[row] += map[o * LOCAL + l] * half[o][row];
            for (long row = 0; row < high && !all_free; row++)
                sum[row] = is_free[row] && is_free[column] ? sum[row] : 0.0;
            for (long row = panel; row < high; row++)
                band[column * high + row - panel] += sum[row];
        }
    }
}

/* curvature of lam' z by the lengths of element k, by_z in place of lam */
static ALWAYS_INLINE void curvature_of_lengths(const Evaluator *e, long k, const double *by_z, const double *c,
                                               double curvature[WIDEST][WIDEST], long m)
{
    double eta[WIDEST], weight[TERMS] = {0.0};
    for (long t = 0; t < e->terms; t++)
        for (long i = 0; i < m; i++)
            for (long j = 0; j < LOCAL; j++)
                weight[t] += by_z[entry(e->term[t].given, m) + i] * e->term[t].row[j] * c[j * m + i];
    eta_of(e, e->at->times, e->stretch, k, eta);
    ssm_term_curvature(e->kind, eta, weight, curvature);
}

/* curvature by (c, tau) and by tau of element k: border and corner. Of the sum of the times, all: its border column, with_all:
 * its curvature with every time, and by itself */
static ALWAYS_INLINE void add_to_border(const Evaluator *e, System *system, long k, const double *h, long m)
{
    const Lengths *lengths = e->lengths + k;
    const long size = GIVEN * m + 1, first = k * e->stride * m, count = lengths->count, b = e->b;
    const double *map = e->maps + k * GIVEN * LOCAL, *by_z = e->dual_by_z + k * size, *c = e->at->c + first;
    const double *by_time = e->by_time + lengths->first * size;
    const unsigned char *is_free = e->program->is_free + first;
    double along[WIDEST][GIVEN * COORDINATES + 1], curvature[WIDEST][WIDEST], of_times[WIDEST][WIDEST] = {{0.0}};
    curvature_of_lengths(e, k, by_z, c, curvature, m);
    for (long i = 0; i < e->w; i++)
        for (long j = 0; j < e->w; j++)
            if (lengths->of[i] >= 0 && lengths->of[j] >= 0)
                of_times[lengths->of[i]][lengths->of[j]] += lengths->share[i] * lengths->share[j] * curvature[i][j];
    for (long x = 0; x < count; x++) {
        const double *of = e->map_slopes + (lengths->first + x) * GIVEN * LOCAL;
        double *border = (lengths->time[x] < b ? system->border + lengths->time[x] * system->padded : e->all) + first;
        for (long r = 0; r < size; r++)
            along[x][r] = 0.0;
        for (long q = 0; q < size; q++)
            for (long r = 0; r < size; r++)
                along[x][r] += by_time[x * size + q] * h[q * size + r];
        for (long j = 0; j < LOCAL; j++)
            for (long i = 0; i < m; i++) {
                double sum = 0.0;
                for (long o = 0; o < GIVEN; o++)
                    sum += map[o * LOCAL + j] * along[x][entry(o, m) + i] + of[o * LOCAL + j] * by_z[entry(o, m) + i];
                border[j * m + i] += is_free[j * m + i] ? sum : 0.0;
            }
    }
    for (long x = 0; x < count; x++)
        for (long y = 0; y < count; y++) {
            const long time = lengths->time[x], other = lengths->time[y];
            const double value = of_times[x][y] + ssm_dot(by_time + x * size, along[y], size);
            if (other < b && time < b)
                system->corner[time * system->columns + other] += value;
            else if (other == b)
                e->with_all[time] += value;
        }
}

/* border and corner of the equalities */
static void add_equalities(const Evaluator *e, System *system)
{
    const Program *p = e->program;
    const long m = e->m, columns = system->columns;
    for (long q = 0; q < p->equal_count; q++) {
        const long k = p->equal_at[q], at = p->equal_entry[q], of = at - (at > LOCAL * m), o = of / m, i = of % m;
        const int length = at == LOCAL * m;
        double *row = system->corner + (e->b + q) * columns;
        for (long j = 0; !length && j < LOCAL; j++) {
            const long unknown = (k * e->stride + j) * m + i;
            if (p->is_free[unknown])
                system->border[(e->b + q) * system->padded + unknown] = e->maps[k * GIVEN * LOCAL + o * LOCAL + j];
        }
        const Lengths *lengths = e->lengths + k;
        for (long x = 0; x < lengths->count; x++) {
            const double slope = e->by_time[(lengths->first + x) * e->states + at];
            for (long b = 0; b < e->b; b++)
                if (lengths->time[x] == e->b || lengths->time[x] == b)
                    row[b] += slope;
        }
    }
    for (long b = 0; e->equal_size > p->equal_count && b < e->b; b++)
        system->corner[(e->b + p->equal_count) * columns + b] = 1.0;
    for (long q = e->b; q < columns; q++)
        for (long b = 0; b < e->b; b++)
            system->corner[b * columns + q] = system->corner[q * columns + b];
}

static ALWAYS_INLINE void add_elements(const Evaluator *e, System *system, const double *sigma, long m)
{
    double h[(GIVEN * COORDINATES + 1) * (GIVEN * COORDINATES + 1)];
    for (long k = 0; k < e->n; k++) {
        hessian_by_z(e, k, sigma, h, m);
        add_to_band(e, system, k, h, m);
        add_to_border(e, system, k, h, m);
    }
}

/* of f + lam' rows + nu' equalities (lam and sigma those of ssm_differentiate, nu that of ssm_dual) + J' diag(sigma) J + STIFF A' A of the equalities in elements */
void ssm_newton_matrix(Evaluator *e, System *system, const double *sigma)
{
    const Program *p = e->program;
    const long columns = system->columns;
    memset(system->band, 0, (size_t)(e->size * system->high) * sizeof(double));
    memset(system->border, 0, (size_t)(system->padded * columns) * sizeof(double));
    memset(system->corner, 0, (size_t)(columns * columns) * sizeof(double));
    memset(e->all, 0, (size_t)e->size * sizeof(double));
    memset(e->with_all, 0, (size_t)(e->b + 1) * sizeof(double));
    FOR_COORDINATES(e->m, add_elements(e, system, sigma, m))
    if (p->stretched_from > 0.0 && e->kind == HERMITE && e->b > 1)
        for (long b = 0; b < e->b; b++)
            for (long i = 0; i < e->size; i++)
                system->border[b * system->padded + i] += e->all[i];
    const double *times = sigma + e->first_time;
    double of_totals = e->with_all[e->b];
    for (long t = 0; t < e->total_count; t++)
        of_totals += times[e->b + t] * e->totals[t] * e->totals[t];
    for (long i = 0; i < e->b; i++)
        for (long j = 0; j < e->b; j++) {
            const double least = p->least_times[i] * p->least_times[j], own = i == j ? 1.0 : 0.0, b = (double)e->b;
            system->corner[i * columns + j] += of_totals + e->with_all[i] + e->with_all[j] + own * times[i] / least +
                                               2.0 * p->even / b * (own - 1.0 / b) / least;
        }
    add_equalities(e, system);
}
