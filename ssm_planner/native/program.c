/* Values of a program on a mesh of cubic elements and, at one point, its first and second derivatives.
 *
 *     min   w_t sum T + w_c sum_k L(z_k) + sum_k h_k sum_i p_i (a_0^2 + a_0 a_1 + a_1^2)_i + e var(T / T_least)
 *     s.t.  G_j(z_k) <= bound of every group j at its elements k,   A z_k <= bound,   T >= T_least,   low <= sum T <= high
 *           z_k[i] = value for a few (k, i);   some unknowns fixed
 *
 * z_k (5 m + 1) is element k, of which G and L take all but its last m entries; the unknowns are (c, T). Everything is
 * differentiated by z first and brought to the unknowns of an element, (c_f .. c_{f+3}, eta), by one congruence, and from eta
 * to T. Its matrix is M x I_m by the coordinates, whatever the coordinate: nothing of it is multiplied out, and a linear row is
 * as short as its entries. eta depends on one time for every length, and on all times alike for the stretch s = sum T / S_0.
 *
 * What has no bound, or does not depend on an unknown that is free, does not count: a row that is identically zero would keep
 * its slack at zero. Rows that count stand one after the other, those of every group, the linear ones, the times.
 */

#include <math.h>
#include <string.h>

#include "interior.h"

static const double NOTHING = 1e-9; /* a state that depends on an unknown by less than this share does not depend on it */
static const double STIFF = 1e3;    /* of the springs that hold what equalities give: without them K is nearly singular there */

/* entry of z of coordinate i of given row o */
static long entry(const Evaluator *e, long o, long i)
{
    return o * e->m + i + (o == LOCAL);
}

static double total(const double *values, long count)
{
    double sum = 0.0;
    for (long i = 0; i < count; i++)
        sum += values[i];
    return sum;
}

/* s = sum T / S_0; of nodes that hold the velocity itself it is `otherwise`, 1 or, for a step, 0 */
static double stretch_of(const Evaluator *e, const double *times, double otherwise)
{
    const double from = e->program->stretched_from;
    return from > 0.0 ? total(times, e->b) / from : otherwise;
}

/* lengths eta of element k at times T, or the change of both */
static void eta_of(const Evaluator *e, const double *times, double stretch, long k, double eta[WIDEST])
{
    const Program *p = e->program;
    if (e->kind == HERMITE) {
        eta[0] = p->fractions[k] * times[p->block[k]];
        eta[1] = stretch;
        return;
    }
    for (long j = 0; j < e->w; j++) {
        const long at = k + j - 2;
        eta[j] = at < 0 || at >= e->n ? 0.0 : p->fractions[at] * times[p->block[at]];
    }
}

/* block on which length j of element k depends, and by how much: -1 of all of them, -2 of none */
static long block_of(const Evaluator *e, long k, long j, double *share)
{
    const Program *p = e->program;
    const long at = e->kind == HERMITE ? k : k + j - 2;
    if (e->kind == HERMITE && j == 1) {
        *share = p->stretched_from > 0.0 ? 1.0 / p->stretched_from : 0.0;
        return p->stretched_from > 0.0 ? -1 : -2;
    }
    if (at < 0 || at >= e->n)
        return -2;
    *share = p->fractions[at];
    return p->block[at];
}

/* ---- which rows count */

static void sparse_rows(Evaluator *e)
{
    const Program *p = e->program;
    long count = 0;
    for (long l = 0; l < p->linear_rows; l++) {
        e->a_first[l] = count;
        for (long i = 0; i < e->states; i++)
            if (p->matrix[l * e->states + i] != 0.0) {
                e->a_column[count] = i;
                e->a_value[count++] = p->matrix[l * e->states + i];
            }
    }
    e->a_first[p->linear_rows] = count;
}

/* whether linear row l depends on an unknown of element k that is free; matrix: M there */
static int depends(const Evaluator *e, long k, long l, double matrix[GIVEN][LOCAL])
{
    const Program *p = e->program;
    for (long q = 0; q < p->equal_count; q++)
        if (p->equal_at[q] == k && p->matrix[l * e->states + p->equal_entry[q]] != 0.0)
            return 0;
    for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++) {
        const long column = e->a_column[a], of_state = column - (column > LOCAL * e->m), i = of_state % e->m;
        const double *row = matrix[of_state / e->m];
        if (column == LOCAL * e->m)
            continue;
        const double most = fmax(fmax(fabs(row[0]), fabs(row[1])), fmax(fabs(row[2]), fabs(row[3])));
        for (long j = 0; j < LOCAL; j++)
            if (fabs(row[j]) / most > NOTHING && p->is_free[(k * e->stride + j) * e->m + i])
                return 1;
    }
    return 0;
}

static void choose_rows(Evaluator *e)
{
    const Program *p = e->program;
    long active = 0, all = 0;
    for (long g = 0; g < p->group_count; g++) {
        const RowGroup *group = p->groups + g;
        for (long at = 0; at < group->functions.count; at++) {
            e->parts[g].first[at] = active;
            for (long row = 0; row < group->functions.rows; row++, all++)
                if (isfinite(group->bound[at * group->functions.rows + row])) {
                    e->place_of[active] = all;
                    e->column[active++] = row;
                }
        }
        e->parts[g].first[group->functions.count] = active;
    }
    Part *linear = e->parts + p->group_count;
    const double stretch = stretch_of(e, p->least_times, 1.0);
    for (long k = 0; k < e->n; k++) {
        double eta[WIDEST], matrix[GIVEN][LOCAL];
        eta_of(e, p->least_times, stretch, k, eta);
        ssm_matrix(e->kind, eta, matrix);
        linear->first[k] = active;
        for (long l = 0; l < p->linear_rows; l++, all++) {
            const double bound = p->bound[k * p->linear_rows + l];
            if (isfinite(bound) && depends(e, k, l, matrix)) {
                e->scale[active] = bound > 0.0 ? 1.0 / bound : 1.0;
                e->place_of[active] = all;
                e->column[active++] = l;
            }
        }
    }
    linear->first[e->n] = e->first_time = active;
    for (long j = 0; j < e->b + e->total_count; j++)
        e->place_of[active++] = all++;
    e->active = active;
    e->all = all;
}

/* members of a group by element */
static void sort_members(const Evaluator *e, Part *part, const long *elements)
{
    for (long at = 0; at < part->count; at++)
        part->member_at[elements[at] + 1]++;
    for (long k = 0; k < e->n; k++)
        part->member_at[k + 1] += part->member_at[k];
    for (long at = part->count - 1; at >= 0; at--)
        part->member[--part->member_at[elements[at] + 1]] = at;
    /* each counter now begins its element: shift them into place */
    for (long k = 0; k < e->n; k++)
        part->member_at[k] = part->member_at[k + 1];
    part->member_at[e->n] = part->count;
}

static void reserve_part(Evaluator *e, Part *part, const RowGroup *group)
{
    const long count = group->functions.count, rows = group->functions.rows, size = group->functions.size_z;
    Memory *memory = &e->memory;
    part->count = count;
    part->first = ssm_longs(memory, count + 1);
    part->member_at = ssm_longs(memory, e->n + 1);
    part->member = ssm_longs(memory, count);
    part->z = ssm_doubles(memory, count * size);
    part->values = ssm_doubles(memory, count * rows);
    part->jacobian = ssm_doubles(memory, count * rows * size);
    part->hessian = ssm_doubles(memory, count * size * size);
    part->multipliers = ssm_doubles(memory, count * (rows + 1));
    part->cost = ssm_doubles(memory, count * size);
    if (memory->failed)
        return;
    sort_members(e, part, group->elements);
    if (group->functions.cost_of != NULL)
        for (long at = 0; at < count; at++)
            part->multipliers[at * (rows + 1) + rows] = group->cost_weight;
}

/* 0 where memory does not suffice */
int ssm_evaluator_new(Evaluator *e, const Program *p)
{
    memset(e, 0, sizeof *e);
    e->program = p;
    e->kind = (int)p->kind;
    e->m = p->coordinates;
    e->n = p->elements;
    e->b = p->blocks;
    e->w = e->kind == HERMITE ? 2 : 5;
    e->own = e->kind == HERMITE ? 0 : 2;
    e->stride = e->kind == HERMITE ? 2 : 1;
    e->terms = ssm_terms(e->kind, &e->term);
    e->nodes = e->stride * (e->n - 1) + LOCAL;
    e->size = e->nodes * e->m;
    e->states = GIVEN * e->m + 1;
    const int fixed = p->low == p->high;
    if (!fixed && isfinite(p->high))
        e->totals[e->total_count++] = 1.0 / p->high;
    if (!fixed && p->low > 0.0)
        e->totals[e->total_count++] = -1.0 / p->low;
    e->equal_size = p->equal_count + fixed;
    long most = e->n * p->linear_rows + e->b + e->total_count;
    for (long g = 0; g < p->group_count; g++)
        most += p->groups[g].functions.count * p->groups[g].functions.rows;
    Memory *memory = &e->memory;
    e->place_of = ssm_longs(memory, most);
    e->column = ssm_longs(memory, most);
    e->scale = ssm_doubles(memory, most);
    e->a_first = ssm_longs(memory, p->linear_rows + 1);
    e->a_column = ssm_longs(memory, p->linear_rows * e->states);
    e->a_value = ssm_doubles(memory, p->linear_rows * e->states);
    e->maps = ssm_doubles(memory, e->n * GIVEN * LOCAL);
    e->slopes = ssm_doubles(memory, e->n * TERMS * WIDEST);
    e->by_eta = ssm_doubles(memory, e->n * GIVEN * e->m * e->w);
    e->cost_by_z = ssm_doubles(memory, e->n * e->states);
    e->dual_by_z = ssm_doubles(memory, e->n * e->states);
    e->by_z = ssm_doubles(memory, e->n * e->states);
    e->dz = ssm_doubles(memory, e->n * e->states);
    e->h = ssm_doubles(memory, e->states * e->states);
    e->t = ssm_doubles(memory, e->states * LOCAL * e->m);
    e->he = ssm_doubles(memory, e->states * e->w);
    e->parts = (Part *)(void *)ssm_doubles(memory, (p->group_count + 1) * (long)(sizeof(Part) / sizeof(double) + 1));
    if (memory->failed)
        return 0;
    for (long g = 0; g < p->group_count; g++)
        reserve_part(e, e->parts + g, p->groups + g);
    e->parts[p->group_count].count = e->n;
    e->parts[p->group_count].first = ssm_longs(memory, e->n + 1);
    if (memory->failed)
        return 0;
    sparse_rows(e);
    choose_rows(e);
    return 1;
}

/* ---- values */

static void elements_of(const Evaluator *e, Place *place)
{
    const double stretch = stretch_of(e, place->times, 1.0);
    for (long k = 0; k < e->n; k++) {
        double eta[WIDEST], matrix[GIVEN][LOCAL], *z = place->z + k * e->states;
        const double *c = place->c + k * e->stride * e->m;
        eta_of(e, place->times, stretch, k, eta);
        ssm_matrix(e->kind, eta, matrix);
        for (long o = 0; o < GIVEN; o++)
            for (long i = 0; i < e->m; i++)
                z[entry(e, o, i)] = matrix[o][0] * c[i] + matrix[o][1] * c[e->m + i] + matrix[o][2] * c[2 * e->m + i] +
                                    matrix[o][3] * c[3 * e->m + i];
        z[LOCAL * e->m] = eta[e->own];
    }
}

static void gather(const Evaluator *e, long g, const double *z)
{
    const RowGroup *group = e->program->groups + g;
    const long size = group->functions.size_z;
    for (long at = 0; at < group->functions.count; at++)
        memcpy(e->parts[g].z + at * size, z + group->elements[at] * e->states, (size_t)size * sizeof(double));
}

static double linear_value(const Evaluator *e, long l, const double *z)
{
    double sum = 0.0;
    for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++)
        sum += e->a_value[a] * z[e->a_column[a]];
    return sum;
}

/* derivative of e var(T / T_least) by T_i: e 2 / b (T_i / l_i - mean of T / l) / l_i */
static double evenness_slope(const Evaluator *e, const double *times, long i)
{
    const double *least = e->program->least_times, b = (double)e->b;
    double mean = 0.0;
    if (e->program->even == 0.0)
        return 0.0;
    for (long j = 0; j < e->b; j++)
        mean += times[j] / least[j] / b;
    return 2.0 * e->program->even / b * (times[i] / least[i] - mean) / least[i];
}

static double smoothing(const Evaluator *e, const double *z)
{
    const double *first = z + 2 * e->m, *last = z + 3 * e->m;
    double sum = 0.0;
    for (long i = 0; i < e->m; i++)
        sum += e->program->smoothing[i] * (first[i] * first[i] + first[i] * last[i] + last[i] * last[i]);
    return sum;
}

/* z, rows, equalities and objective of the point c, T */
void ssm_values(Evaluator *e, Place *place)
{
    const Program *p = e->program;
    elements_of(e, place);
    double sum = total(place->times, e->b), objective = p->time_weight * sum;
    for (long j = 0; p->even != 0.0 && j < e->b; j++)
        objective += place->times[j] * evenness_slope(e, place->times, j) / 2.0;
    for (long k = 0; k < e->n; k++)
        objective += place->z[k * e->states + LOCAL * e->m] * smoothing(e, place->z + k * e->states);
    for (long g = 0; g < p->group_count; g++) {
        const RowGroup *group = p->groups + g;
        const ElementGroup *f = &group->functions;
        Part *part = e->parts + g;
        gather(e, g, place->z);
        e->failed |= f->rows_of(f->context, part->z, part->values);
        for (long at = 0; at < part->count; at++)
            for (long a = part->first[at]; a < part->first[at + 1]; a++) {
                const long of = at * f->rows + e->column[a];
                place->rows[a] = part->values[of] - group->bound[of];
            }
        if (group->cost_weight != 0.0 && f->cost_of != NULL) {
            e->failed |= f->cost_of(f->context, part->z, part->cost);
            objective += group->cost_weight * total(part->cost, part->count);
        }
    }
    place->objective = objective;
    const Part *linear = e->parts + p->group_count;
    for (long k = 0; k < e->n; k++)
        for (long a = linear->first[k]; a < linear->first[k + 1]; a++) {
            const double value = linear_value(e, e->column[a], place->z + k * e->states);
            place->rows[a] = (value - p->bound[k * p->linear_rows + e->column[a]]) * e->scale[a];
        }
    double *times = place->rows + e->first_time;
    for (long j = 0; j < e->b; j++)
        times[j] = 1.0 - place->times[j] / p->least_times[j];
    for (long t = 0; t < e->total_count; t++)
        times[e->b + t] = e->totals[t] * sum - copysign(1.0, e->totals[t]);
    for (long q = 0; q < p->equal_count; q++)
        place->equal[q] = place->z[p->equal_at[q] * e->states + p->equal_entry[q]] - p->equal_value[q];
    if (e->equal_size > p->equal_count)
        place->equal[p->equal_count] = sum - p->low;
}

/* ---- first derivatives */

static void maps_of(const Evaluator *e, const Place *place, long k)
{
    double eta[WIDEST], matrix[GIVEN][LOCAL], slope[TERMS][WIDEST];
    const double *c = place->c + k * e->stride * e->m;
    double *by_eta = e->by_eta + k * GIVEN * e->m * e->w;
    eta_of(e, place->times, e->stretch, k, eta);
    ssm_matrix(e->kind, eta, matrix);
    ssm_term_slopes(e->kind, eta, slope);
    memcpy(e->maps + k * GIVEN * LOCAL, matrix, sizeof matrix);
    memcpy(e->slopes + k * TERMS * WIDEST, slope, sizeof slope);
    memset(by_eta, 0, (size_t)(GIVEN * e->m * e->w) * sizeof(double));
    for (long t = 0; t < e->terms; t++)
        for (long i = 0; i < e->m; i++) {
            const double *row = e->term[t].row;
            const double value = row[0] * c[i] + row[1] * c[e->m + i] + row[2] * c[2 * e->m + i] + row[3] * c[3 * e->m + i];
            double *of = by_eta + (e->term[t].given * e->m + i) * e->w;
            for (long j = 0; j < e->w; j++)
                of[j] += slope[t][j] * value;
        }
}

/* choose the point of the derivatives */
void ssm_differentiate(Evaluator *e, const Place *place)
{
    const Program *p = e->program;
    const long m = e->m;
    e->at = place;
    e->stretch = stretch_of(e, place->times, 1.0);
    for (long k = 0; k < e->n; k++) {
        const double *z = place->z + k * e->states, h = z[LOCAL * m];
        double *by_z = e->cost_by_z + k * e->states;
        maps_of(e, place, k);
        memset(by_z, 0, (size_t)e->states * sizeof(double));
        for (long i = 0; i < m; i++) {
            by_z[2 * m + i] = h * p->smoothing[i] * (2.0 * z[2 * m + i] + z[3 * m + i]);
            by_z[3 * m + i] = h * p->smoothing[i] * (2.0 * z[3 * m + i] + z[2 * m + i]);
        }
        by_z[LOCAL * m] = smoothing(e, z);
    }
    for (long g = 0; g < p->group_count; g++) {
        const RowGroup *group = p->groups + g;
        const ElementGroup *f = &group->functions;
        Part *part = e->parts + g;
        gather(e, g, place->z);
        e->failed |= f->jacobian_of(f->context, part->z, part->jacobian);
        if (group->cost_weight == 0.0 || f->gradient_of == NULL)
            continue;
        e->failed |= f->gradient_of(f->context, part->z, part->cost);
        for (long at = 0; at < part->count; at++)
            for (long i = 0; i < f->size_z; i++)
                e->cost_by_z[group->elements[at] * e->states + i] += group->cost_weight * part->cost[at * f->size_z + i];
    }
}

/* by_z: of the objective and J' weights of the rows, and of the equalities with `springs` times `equal` */
static void slope_by_z(const Evaluator *e, const double *weights, const double *equal, double springs, double *by_z)
{
    const Program *p = e->program;
    memcpy(by_z, e->cost_by_z, (size_t)(e->n * e->states) * sizeof(double));
    for (long g = 0; g < p->group_count; g++) {
        const ElementGroup *f = &p->groups[g].functions;
        const Part *part = e->parts + g;
        for (long at = 0; at < part->count; at++) {
            double *of = by_z + p->groups[g].elements[at] * e->states;
            for (long a = part->first[at]; a < part->first[at + 1]; a++) {
                const double *row = part->jacobian + (at * f->rows + e->column[a]) * f->size_z;
                for (long i = 0; i < f->size_z; i++)
                    of[i] += weights[a] * row[i];
            }
        }
    }
    const Part *linear = e->parts + p->group_count;
    for (long k = 0; k < e->n; k++)
        for (long r = linear->first[k]; r < linear->first[k + 1]; r++) {
            const long l = e->column[r];
            for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++)
                by_z[k * e->states + e->a_column[a]] += weights[r] * e->scale[r] * e->a_value[a];
        }
    for (long q = 0; q < p->equal_count; q++)
        by_z[p->equal_at[q] * e->states + p->equal_entry[q]] += springs * equal[q];
}

/* a slope by the elements as one by the unknowns (c, T), that of the rows of times with these weights included */
static void pull(const Evaluator *e, const double *by_z, const double *weights, double *found)
{
    const Program *p = e->program;
    const long m = e->m;
    double *by_t = found + e->size, of_all = p->time_weight;
    memset(found, 0, (size_t)(e->size + e->b) * sizeof(double));
    for (long k = 0; k < e->n; k++) {
        const double *slope = by_z + k * e->states, *map = e->maps + k * GIVEN * LOCAL;
        const double *by_eta = e->by_eta + k * GIVEN * m * e->w;
        double of_eta[WIDEST] = {0.0}, *of_c = found + k * e->stride * m;
        of_eta[e->own] = slope[LOCAL * m];
        for (long o = 0; o < GIVEN; o++)
            for (long i = 0; i < m; i++) {
                const double value = slope[entry(e, o, i)];
                for (long j = 0; j < LOCAL; j++)
                    of_c[j * m + i] += map[o * LOCAL + j] * value;
                for (long j = 0; j < e->w; j++)
                    of_eta[j] += by_eta[(o * m + i) * e->w + j] * value;
            }
        for (long j = 0; j < e->w; j++) {
            double share = 0.0;
            const long block = block_of(e, k, j, &share);
            if (block >= 0)
                by_t[block] += share * of_eta[j];
            else if (block == -1)
                of_all += share * of_eta[j];
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

/* gradient of f + lam' rows + nu' equalities, (size + b) */
void ssm_dual(Evaluator *e, const double *lam, const double *nu, double *dual)
{
    slope_by_z(e, lam, nu, 1.0, e->dual_by_z);
    pull(e, e->dual_by_z, lam, dual);
    if (e->equal_size > e->program->equal_count)
        for (long j = 0; j < e->b; j++)
            dual[e->size + j] += nu[e->program->equal_count];
}

/* gradient of f + J' weights + STIFF A' e: with it on the right-hand side the step is as without STIFF A' A in the matrix */
void ssm_right_side(Evaluator *e, const double *weights, double *right)
{
    slope_by_z(e, weights, e->at->equal, STIFF, e->by_z);
    pull(e, e->by_z, weights, right);
}

/* change of the rows along a step; returns that of f */
double ssm_along(Evaluator *e, const double *dc, const double *dt, double *change)
{
    const Program *p = e->program;
    const long m = e->m;
    double slope = 0.0;
    const double stretch = stretch_of(e, dt, 0.0);
    for (long k = 0; k < e->n; k++) {
        double eta[WIDEST], *dz = e->dz + k * e->states;
        const double *map = e->maps + k * GIVEN * LOCAL, *by_eta = e->by_eta + k * GIVEN * m * e->w;
        const double *c = dc + k * e->stride * m;
        eta_of(e, dt, stretch, k, eta);
        for (long o = 0; o < GIVEN; o++)
            for (long i = 0; i < m; i++) {
                double value = 0.0;
                for (long j = 0; j < LOCAL; j++)
                    value += map[o * LOCAL + j] * c[j * m + i];
                for (long j = 0; j < e->w; j++)
                    value += by_eta[(o * m + i) * e->w + j] * eta[j];
                dz[entry(e, o, i)] = value;
            }
        dz[LOCAL * m] = eta[e->own];
        for (long i = 0; i < e->states; i++)
            slope += e->cost_by_z[k * e->states + i] * dz[i];
    }
    for (long g = 0; g < p->group_count; g++) {
        const ElementGroup *f = &p->groups[g].functions;
        const Part *part = e->parts + g;
        for (long at = 0; at < part->count; at++) {
            const double *dz = e->dz + p->groups[g].elements[at] * e->states;
            for (long a = part->first[at]; a < part->first[at + 1]; a++) {
                const double *row = part->jacobian + (at * f->rows + e->column[a]) * f->size_z;
                change[a] = 0.0;
                for (long i = 0; i < f->size_z; i++)
                    change[a] += row[i] * dz[i];
            }
        }
    }
    const Part *linear = e->parts + p->group_count;
    for (long k = 0; k < e->n; k++)
        for (long a = linear->first[k]; a < linear->first[k + 1]; a++)
            change[a] = linear_value(e, e->column[a], e->dz + k * e->states) * e->scale[a];
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

/* h, lower triangle: of f + lam' rows + J' diag(sigma) J + STIFF A' A, by the entries of element k */
static void hessian_by_z(const Evaluator *e, long k, const double *sigma)
{
    const Program *p = e->program;
    const long m = e->m, size = e->states;
    const double *z = e->at->z + k * size;
    double *h = e->h;
    memset(h, 0, (size_t)(size * size) * sizeof(double));
    for (long i = 0; i < m; i++) {
        const double weight = p->smoothing[i], first = z[2 * m + i], last = z[3 * m + i], length = z[LOCAL * m];
        h[(2 * m + i) * size + 2 * m + i] = h[(3 * m + i) * size + 3 * m + i] = 2.0 * weight * length;
        h[(3 * m + i) * size + 2 * m + i] = weight * length;
        h[LOCAL * m * size + 2 * m + i] = weight * (2.0 * first + last);
        h[LOCAL * m * size + 3 * m + i] = weight * (2.0 * last + first);
    }
    const Part *linear = e->parts + p->group_count;
    for (long r = linear->first[k]; r < linear->first[k + 1]; r++) {
        const long l = e->column[r];
        const double weight = sigma[r] * e->scale[r] * e->scale[r];
        for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++)
            for (long b = e->a_first[l]; b <= a; b++)
                h[e->a_column[a] * size + e->a_column[b]] += weight * e->a_value[a] * e->a_value[b];
    }
    for (long q = 0; q < p->equal_count; q++)
        if (p->equal_at[q] == k)
            h[p->equal_entry[q] * size + p->equal_entry[q]] += STIFF;
    for (long g = 0; g < p->group_count; g++) {
        const ElementGroup *f = &p->groups[g].functions;
        const Part *part = e->parts + g;
        for (long of = part->member_at[k]; of < part->member_at[k + 1]; of++) {
            const long at = part->member[of], width = f->size_z;
            const double *own = part->hessian + at * width * width;
            for (long i = 0; i < width; i++)
                for (long j = 0; j <= i; j++)
                    h[i * size + j] += own[i * width + j];
            for (long r = part->first[at]; r < part->first[at + 1]; r++) {
                const double *row = part->jacobian + (at * f->rows + e->column[r]) * width;
                for (long i = 0; i < width; i++) {
                    const double share = sigma[r] * row[i];
                    for (long j = 0; share != 0.0 && j <= i; j++)
                        h[i * size + j] += share * row[j];
                }
            }
        }
    }
    for (long i = 0; i < size; i++)
        for (long j = 0; j < i; j++)
            h[j * size + i] = h[i * size + j];
}

/* add (M x I)' h (M x I) of element k to the band; he: h times the slopes of z by eta */
static void add_to_band(const Evaluator *e, System *system, long k)
{
    const long m = e->m, width = LOCAL * m, size = e->states;
    const double *map = e->maps + k * GIVEN * LOCAL, *h = e->h;
    const unsigned char *is_free = e->program->is_free + k * e->stride * m;
    const long wide = system->wide, high = system->high;
    double *t = e->t, *band = system->band + k * wide * high;
    for (long o = 0; o < GIVEN; o++)
        for (long i = 0; i < m; i++) {
            const double *row = h + entry(e, o, i) * size;
            double *of = t + (o * m + i) * width;
            for (long j = 0; j < LOCAL; j++)
                for (long x = 0; x < m; x++)
                    of[j * m + x] = row[x] * map[j] + row[m + x] * map[LOCAL + j] + row[2 * m + x] * map[2 * LOCAL + j] +
                                    row[3 * m + x] * map[3 * LOCAL + j] + row[4 * m + 1 + x] * map[4 * LOCAL + j];
        }
    for (long j = 0; j < LOCAL; j++)
        for (long i = 0; i < m; i++) {
            const long row = j * m + i;
            if (!is_free[row])
                continue;
            for (long column = 0; column <= row; column++) {
                double sum = 0.0;
                for (long o = 0; o < GIVEN; o++)
                    sum += map[o * LOCAL + j] * t[(o * m + i) * width + column];
                if (is_free[column])
                    band[column * high + row - (column & -wide)] += sum;
            }
        }
}

/* curvature by (c, eta) and by eta of element k, brought to the times: border and corner. all: of the sum of the times,
 * its border column, its curvature with every time, and by itself */
static inline void add_to_border_of(const Evaluator *e, System *system, long k, double *all, double *with_all, const long w)
{
    const long m = e->m, size = e->states, columns = system->columns;
    const double *map = e->maps + k * GIVEN * LOCAL, *by_eta = e->by_eta + k * GIVEN * m * w;
    const double *slope = e->slopes + k * TERMS * WIDEST, *c = e->at->c + k * e->stride * m;
    const double *by_z = e->dual_by_z + k * size;
    const long first = k * e->stride * m;
    double *he = e->he, eta[WIDEST], of_eta[WIDEST][WIDEST], weight[TERMS] = {0.0}, share[WIDEST] = {0.0};
    long block[WIDEST];
    for (long r = 0; r < size; r++) {
        double sum[WIDEST] = {0.0};
        sum[e->own] = e->h[r * size + LOCAL * m];
        for (long o = 0; o < GIVEN; o++)
            for (long i = 0; i < m; i++)
                for (long j = 0; j < w; j++)
                    sum[j] += e->h[r * size + entry(e, o, i)] * by_eta[(o * m + i) * w + j];
        memcpy(he + r * w, sum, (size_t)w * sizeof(double));
    }
    for (long t = 0; t < e->terms; t++)
        for (long i = 0; i < m; i++)
            for (long j = 0; j < LOCAL; j++)
                weight[t] += by_z[entry(e, e->term[t].given, i)] * e->term[t].row[j] * c[j * m + i];
    eta_of(e, e->at->times, e->stretch, k, eta);
    ssm_term_curvature(e->kind, eta, weight, of_eta);
    for (long y = 0; y < w; y++)
        of_eta[e->own][y] += he[LOCAL * m * w + y];
    for (long o = 0; o < GIVEN; o++)
        for (long i = 0; i < m; i++)
            for (long x = 0; x < w; x++)
                for (long y = 0; y < w; y++)
                    of_eta[x][y] += by_eta[(o * m + i) * w + x] * he[entry(e, o, i) * w + y];
    for (long x = 0; x < w; x++)
        block[x] = block_of(e, k, x, share + x);
    for (long j = 0; j < LOCAL; j++)
        for (long i = 0; i < m; i++) {
            const long row = first + j * m + i;
            double sum[WIDEST] = {0.0};
            if (!e->program->is_free[row])
                continue;
            for (long o = 0; o < GIVEN; o++)
                for (long x = 0; x < w; x++)
                    sum[x] += map[o * LOCAL + j] * he[entry(e, o, i) * w + x];
            for (long t = 0; t < e->terms; t++) {
                const double value = by_z[entry(e, e->term[t].given, i)] * e->term[t].row[j];
                for (long x = 0; x < w; x++)
                    sum[x] += value * slope[t * WIDEST + x];
            }
            for (long x = 0; x < w; x++)
                if (block[x] > -2)
                    (block[x] < 0 ? all : system->border + block[x] * system->padded)[row] += share[x] * sum[x];
        }
    for (long x = 0; x < w; x++)
        for (long y = 0; y < w; y++) {
            const double value = share[x] * share[y] * of_eta[x][y];
            if (block[x] >= 0 && block[y] >= 0)
                system->corner[block[x] * columns + block[y]] += value;
            else if (block[x] >= 0 && block[y] == -1)
                with_all[block[x]] += value;
            else if (block[x] == -1 && block[y] == -1)
                with_all[e->b] += value;
        }
}

static void add_to_border(const Evaluator *e, System *system, long k, double *all, double *with_all)
{
    if (e->kind == HERMITE) /* a width that the compiler knows */
        add_to_border_of(e, system, k, all, with_all, 2);
    else
        add_to_border_of(e, system, k, all, with_all, WIDEST);
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
        for (long x = 0; x < e->w; x++) {
            double share = 0.0;
            const long block = block_of(e, k, x, &share);
            const double slope = length ? (double)(x == e->own) : e->by_eta[(k * GIVEN * m + o * m + i) * e->w + x];
            for (long b = 0; b < e->b; b++)
                if (block == -1 || block == b)
                    row[b] += share * slope;
        }
    }
    for (long b = 0; e->equal_size > p->equal_count && b < e->b; b++)
        system->corner[(e->b + p->equal_count) * columns + b] = 1.0;
    for (long q = e->b; q < columns; q++)
        for (long b = 0; b < e->b; b++)
            system->corner[b * columns + q] = system->corner[q * columns + b];
}

/* of f + lam' rows + nu' equalities (those of ssm_dual) + J' diag(sigma) J + STIFF A' A of the equalities in elements */
void ssm_newton_matrix(Evaluator *e, System *system, const double *lam, const double *sigma)
{
    const Program *p = e->program;
    const long columns = system->columns;
    double *all = e->by_z, *with_all = e->dz; /* both are free here, and long enough: size <= n (5 m + 1) + 4 m */
    memset(system->band, 0, (size_t)(e->size * system->high) * sizeof(double));
    memset(system->border, 0, (size_t)(system->padded * columns) * sizeof(double));
    memset(system->corner, 0, (size_t)(columns * columns) * sizeof(double));
    memset(all, 0, (size_t)e->size * sizeof(double));
    memset(with_all, 0, (size_t)(e->b + 1) * sizeof(double));
    for (long g = 0; g < p->group_count; g++) {
        const ElementGroup *f = &p->groups[g].functions;
        Part *part = e->parts + g;
        const long width = f->rows + (f->cost_of != NULL);
        for (long at = 0; at < part->count; at++)
            for (long a = part->first[at]; a < part->first[at + 1]; a++)
                part->multipliers[at * width + e->column[a]] = lam[a];
        e->failed |= f->hessian_of(f->context, part->z, part->multipliers, part->hessian);
    }
    for (long k = 0; k < e->n; k++) {
        hessian_by_z(e, k, sigma);
        add_to_band(e, system, k);
        add_to_border(e, system, k, all, with_all);
    }
    if (p->stretched_from > 0.0 && e->kind == HERMITE)
        for (long b = 0; b < e->b; b++)
            for (long i = 0; i < e->size; i++)
                system->border[b * system->padded + i] += all[i];
    const double *times = sigma + e->first_time;
    double of_totals = with_all[e->b];
    for (long t = 0; t < e->total_count; t++)
        of_totals += times[e->b + t] * e->totals[t] * e->totals[t];
    for (long i = 0; i < e->b; i++)
        for (long j = 0; j < e->b; j++) {
            const double least = p->least_times[i] * p->least_times[j], own = i == j ? 1.0 : 0.0, b = (double)e->b;
            system->corner[i * columns + j] += of_totals + with_all[i] + with_all[j] + own * times[i] / least +
                                               2.0 * p->even / b * (own - 1.0 / b) / least;
        }
    add_equalities(e, system);
}
