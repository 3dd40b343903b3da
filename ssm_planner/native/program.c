/* A program on a mesh of cubic elements: which of its rows count, and its values.
 *
 *     min   w_t sum T + w_c sum_k L(z_k) + sum_k h_k sum_i p_i (a_0^2 + a_0 a_1 + a_1^2)_i + e var(T / T_least)
 *     s.t.  G_j(z_k) <= bound of every group j at its elements k,   A z_k <= bound,   T >= T_least,   low <= sum T <= high
 *           z_k[i] = value for a few (k, i);   some unknowns fixed
 *
 * z_k (5 m + 1) is element k, of which G and L take all but its last m entries; the unknowns are (c, T), z_k = (M x I_m) c
 * of four rows of unknowns, M of the lengths eta of the elements near (spline.c). Each length is a share of one time, or of all
 * for the stretch s = sum T / S_0. A linear row is as short as its entries.
 *
 * What has no bound, or does not depend on an unknown that is free, does not count: a row that is identically zero would keep
 * its slack at zero. Rows that count stand one after the other, those of every group, the linear ones, the times.
 */

#include <math.h>
#include <string.h>

#include "program.h"

static const double NOTHING = 1e-9; /* a state that depends on an unknown by less than this share does not depend on it */

/* ---- on which times an element's lengths depend */

/* length j of element k is a share of the time of a block, of all times (b), or of none (-1) */
static long time_of(const Evaluator *e, long k, long j, double *share)
{
    const Program *p = e->program;
    const long at = e->kind == HERMITE ? k : k + j - 2;
    if (e->kind == HERMITE && j == 1) {
        *share = p->stretched_from > 0.0 ? 1.0 / p->stretched_from : 0.0;
        return p->stretched_from > 0.0 ? (e->b > 1 ? e->b : 0) : -1;
    }
    *share = at < 0 || at >= e->n ? 0.0 : p->fractions[at];
    return at < 0 || at >= e->n ? -1 : p->block[at];
}

static void choose_times(Evaluator *e)
{
    long first = 0;
    for (long k = 0; k < e->n; k++) {
        Lengths *lengths = e->lengths + k;
        lengths->first = first;
        for (long j = 0; j < e->w; j++) {
            const long time = time_of(e, k, j, lengths->share + j);
            long x = 0;
            while (x < lengths->count && lengths->time[x] != time)
                x++;
            lengths->of[j] = time < 0 ? -1 : x;
            if (time >= 0 && x == lengths->count)
                lengths->time[lengths->count++] = time;
        }
        first += lengths->count;
    }
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

/* whether an equality gives entry `column` of z in element k */
static int is_given(const Program *p, long k, long column)
{
    for (long q = 0; q < p->equal_count; q++)
        if (p->equal_at[q] == k && p->equal_entry[q] == column)
            return 1;
    return 0;
}

/* whether linear row l depends on an unknown of element k that is free and that no equality gives; matrix: M there */
static int depends(const Evaluator *e, long k, long l, double matrix[GIVEN][LOCAL])
{
    const Program *p = e->program;
    for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++) {
        const long column = e->a_column[a], of_state = column - (column > LOCAL * e->m), i = of_state % e->m;
        const double *row = matrix[of_state / e->m];
        if (column == LOCAL * e->m || is_given(p, k, column))
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
    const double stretch = stretch_of(e, p->least_times);
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
    e->all_rows = all;
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
    part->multipliers = ssm_doubles(memory, count * (rows + group->functions.costs));
    part->stiffness = ssm_doubles(memory, count * rows);
    part->cost = ssm_doubles(memory, count * size);
    if (memory->failed)
        return;
    sort_members(e, part, group->elements);
    for (long at = 0; at < count && group->functions.costs; at++)
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
    e->lengths = (Lengths *)(void *)ssm_doubles(memory, e->n * (long)(sizeof(Lengths) / sizeof(double)));
    e->map_slopes = ssm_doubles(memory, e->n * e->w * GIVEN * LOCAL);
    e->by_time = ssm_doubles(memory, e->n * e->w * e->states);
    e->cost_by_z = ssm_doubles(memory, e->n * e->states);
    e->dual_by_z = ssm_doubles(memory, e->n * e->states);
    e->by_z = ssm_doubles(memory, e->n * e->states);
    e->all = ssm_doubles(memory, e->size);
    e->with_all = ssm_doubles(memory, e->b + 1);
    e->parts = (Part *)(void *)ssm_doubles(memory, (p->group_count + 1) * (long)(sizeof(Part) / sizeof(double) + 1));
    if (memory->failed)
        return 0;
    for (long g = 0; g < p->group_count; g++)
        reserve_part(e, e->parts + g, p->groups + g);
    e->parts[p->group_count].count = e->n;
    e->parts[p->group_count].first = ssm_longs(memory, e->n + 1);
    if (memory->failed)
        return 0;
    choose_times(e);
    sparse_rows(e);
    choose_rows(e);
    return 1;
}

/* ---- values */

static ALWAYS_INLINE void elements_of(const Evaluator *e, Place *place, long m)
{
    const double stretch = stretch_of(e, place->times);
    for (long k = 0; k < e->n; k++) {
        double eta[WIDEST], matrix[GIVEN][LOCAL], *z = place->z + k * (GIVEN * m + 1);
        const double *c = place->c + k * e->stride * m;
        eta_of(e, place->times, stretch, k, eta);
        ssm_matrix(e->kind, eta, matrix);
        for (long o = 0; o < GIVEN; o++)
            for (long i = 0; i < m; i++)
                z[entry(o, m) + i] = matrix[o][0] * c[i] + matrix[o][1] * c[m + i] + matrix[o][2] * c[2 * m + i] +
                                     matrix[o][3] * c[3 * m + i];
        z[LOCAL * m] = eta[e->own];
    }
}

/* z of the elements of a group */
void ssm_gather(const Evaluator *e, long g, const double *z)
{
    const RowGroup *group = e->program->groups + g;
    const long size = group->functions.size_z;
    for (long at = 0; at < group->functions.count; at++)
        memcpy(e->parts[g].z + at * size, z + group->elements[at] * e->states, (size_t)size * sizeof(double));
}

/* z, rows, equalities and objective of the point c, T */
void ssm_values(Evaluator *e, Place *place)
{
    const Program *p = e->program;
    FOR_COORDINATES(e->m, elements_of(e, place, m))
    double sum = total(place->times, e->b), objective = p->time_weight * sum;
    for (long j = 0; p->even != 0.0 && j < e->b; j++)
        objective += place->times[j] * evenness_slope(e, place->times, j) / 2.0;
    for (long k = 0; k < e->n; k++)
        objective += place->z[k * e->states + LOCAL * e->m] * smoothing(e, place->z + k * e->states);
    for (long g = 0; g < p->group_count; g++) {
        const RowGroup *group = p->groups + g;
        const ElementGroup *f = &group->functions;
        Part *part = e->parts + g;
        ssm_gather(e, g, place->z);
        e->failed |= f->values_of(f->context, part->z, part->values, part->cost);
        for (long at = 0; at < part->count; at++)
            for (long a = part->first[at]; a < part->first[at + 1]; a++) {
                const long of = at * f->rows + e->column[a];
                place->rows[a] = part->values[of] - group->bound[of];
            }
        if (f->costs)
            objective += group->cost_weight * total(part->cost, part->count);
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
