/* Optimisation problem on a mesh of cubic elements: choice of the active rows, and values.
 *
 *     min   w_t sum T + w_c sum_k L(z_k) + sum_k h_k sum_i p_i (a_0^2 + a_0 a_1 + a_1^2)_i
 *           + e var(T / T_least)
 *     s.t.  G_j(z_k) <= bound of every group j at its elements k,   A z_k <= bound,
 *           T >= T_least,   low <= sum T <= high,
 *           z_k[i] = value for a few (k, i);   some unknowns fixed
 *
 * See interior/problem.py for the symbols. z_k (5 m + 1) describes element k. G and L depend on
 * all of its entries except the last m. The unknowns are (c, T). All entries of z_k except its
 * duration are (M x I_m) c with four rows of unknowns c. M depends on lengths eta near the element
 * (spline.c), and each length is a share of one duration, or the stretch s = sum T / S_0. Only the
 * entries of A that are not 0 are stored.
 *
 * A row of G or A is active if its bound is finite. A row of A must also depend on a free unknown,
 * because a row that is always 0 would keep its slack at 0. The order of the active rows is: those
 * of each group, those of A, T >= T_least, and the bounds of the total duration.
 */

#include <math.h>
#include <string.h>

#include "program.h"

/* Coefficients of M below this share of the largest one in their row count as 0. */
static const double NOTHING = 1e-9;

/* ---- Times on which the lengths of an element depend */

/* Return the index of the block whose duration determines length j of element k. Return b for the
 * sum of all durations, and -1 for a constant. Store the derivative of the length in `share`. */
static long find_time(const Evaluator *e, long k, long j, double *share)
{
    const Program *p = e->program;
    const long neighbour = e->kind == HERMITE ? k : k + j - 2;
    if (e->kind == HERMITE && j == 1) {
        *share = p->stretched_from > 0.0 ? 1.0 / p->stretched_from : 0.0;
        return p->stretched_from > 0.0 ? (e->b > 1 ? e->b : 0) : -1;
    }
    *share = neighbour < 0 || neighbour >= e->n ? 0.0 : p->fractions[neighbour];
    return neighbour < 0 || neighbour >= e->n ? -1 : p->block[neighbour];
}

/* List the different times of each element. */
static void choose_times(Evaluator *e)
{
    long first = 0;
    for (long k = 0; k < e->n; k++) {
        Lengths *lengths = e->lengths + k;
        lengths->first = first;
        for (long j = 0; j < e->w; j++) {
            const long time = find_time(e, k, j, lengths->share + j);
            long index = 0;
            while (index < lengths->count && lengths->time[index] != time) index++;
            lengths->time_index[j] = time < 0 ? -1 : index;
            if (time >= 0 && index == lengths->count) lengths->time[lengths->count++] = time;
        }
        first += lengths->count;
    }
}

/* ---- Choice of the active rows */

/* Store the entries of A that are not 0. */
static void compress_linear_rows(Evaluator *e)
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

/* Return 1 if an equality constraint fixes entry `column` of z of element k, otherwise 0. */
static int is_fixed_by_equality(const Program *p, long k, long column)
{
    for (long q = 0; q < p->equal_count; q++)
        if (p->equal_at[q] == k && p->equal_entry[q] == column) return 1;
    return 0;
}

/* Return 1 if linear row l depends on a free unknown of element k through an entry of z that no
 * equality constraint fixes. Otherwise return 0. matrix: M of the element. */
static int depends_on_free_unknown(const Evaluator *e, long k, long l, double matrix[GIVEN][LOCAL])
{
    const Program *p = e->program;
    for (long a = e->a_first[l]; a < e->a_first[l + 1]; a++) {
        const long column = e->a_column[a], state = column - (column > LOCAL * e->m),
                   i = state % e->m;
        const double *row = matrix[state / e->m];
        if (column == LOCAL * e->m || is_fixed_by_equality(p, k, column)) continue;
        const double largest =
            fmax(fmax(fabs(row[0]), fabs(row[1])), fmax(fabs(row[2]), fabs(row[3])));
        for (long j = 0; j < LOCAL; j++)
            if (fabs(row[j]) / largest > NOTHING && p->is_free[(k * e->stride + j) * e->m + i])
                return 1;
    }
    return 0;
}

/* List the active rows. */
static void choose_rows(Evaluator *e)
{
    const Program *p = e->program;
    long active = 0, all = 0;
    for (long g = 0; g < p->group_count; g++) {
        const RowGroup *group = p->groups + g;
        for (long member = 0; member < group->functions.count; member++) {
            e->parts[g].first[member] = active;
            for (long row = 0; row < group->functions.rows; row++, all++)
                if (isfinite(group->bound[member * group->functions.rows + row])) {
                    e->row_index[active] = all;
                    e->column[active++] = row;
                }
        }
        e->parts[g].first[group->functions.count] = active;
    }
    Part *linear = e->parts + p->group_count;
    const double stretch = compute_stretch(e, p->least_times);
    for (long k = 0; k < e->n; k++) {
        double eta[WIDEST], matrix[GIVEN][LOCAL];
        compute_lengths(e, p->least_times, stretch, k, eta);
        ssm_matrix(e->kind, eta, matrix);
        linear->first[k] = active;
        for (long l = 0; l < p->linear_rows; l++, all++) {
            const double bound = p->bound[k * p->linear_rows + l];
            if (isfinite(bound) && depends_on_free_unknown(e, k, l, matrix)) {
                e->scale[active] = bound > 0.0 ? 1.0 / bound : 1.0;
                e->row_index[active] = all;
                e->column[active++] = l;
            }
        }
    }
    linear->first[e->n] = e->first_time = active;
    for (long j = 0; j < e->b + e->total_count; j++) e->row_index[active++] = all++;
    e->active = active;
    e->all_rows = all;
}

/* Sort the members of a group by their elements (counting sort). */
static void sort_members(const Evaluator *e, Part *part, const long *elements)
{
    for (long member = 0; member < part->count; member++)
        part->member_first[elements[member] + 1]++;
    for (long k = 0; k < e->n; k++) part->member_first[k + 1] += part->member_first[k];
    for (long member = part->count - 1; member >= 0; member--)
        part->member[--part->member_first[elements[member] + 1]] = member;
    /* Entry k + 1 is now where element k begins. Move it to entry k. */
    for (long k = 0; k < e->n; k++) part->member_first[k] = part->member_first[k + 1];
    part->member_first[e->n] = part->count;
}

/* Allocate the arrays of a group. */
static void reserve_part(Evaluator *e, Part *part, const RowGroup *group)
{
    const long count = group->functions.count, rows = group->functions.rows,
               size = group->functions.size_z;
    Memory *memory = &e->memory;
    part->count = count;
    part->first = ssm_longs(memory, count + 1);
    part->member_first = ssm_longs(memory, e->n + 1);
    part->member = ssm_longs(memory, count);
    part->z = ssm_doubles(memory, count * size);
    part->values = ssm_doubles(memory, count * rows);
    part->jacobian = ssm_doubles(memory, count * rows * size);
    part->hessian = ssm_doubles(memory, count * size * size);
    part->multipliers = ssm_doubles(memory, count * (rows + group->functions.costs));
    part->stiffness = ssm_doubles(memory, count * rows);
    part->cost = ssm_doubles(memory, count * size);
    if (memory->failed) return;
    sort_members(e, part, group->elements);
    for (long member = 0; member < count && group->functions.costs; member++)
        part->multipliers[member * (rows + 1) + rows] = group->cost_weight;
}

/* Prepare the evaluation of a problem. Return 0 if there is not enough memory, otherwise 1. */
int ssm_evaluator_new(Evaluator *e, const Program *p)
{
    memset(e, 0, sizeof *e);
    e->program = p;
    e->kind = (int)p->kind;
    e->m = p->coordinates;
    e->n = p->elements;
    e->b = p->blocks;
    e->w = e->kind == HERMITE ? 2 : 5;
    e->duration_index = e->kind == HERMITE ? 0 : 2;
    e->stride = e->kind == HERMITE ? 2 : 1;
    e->terms = ssm_terms(e->kind, &e->term);
    e->nodes = e->stride * (e->n - 1) + LOCAL;
    e->size = e->nodes * e->m;
    e->states = GIVEN * e->m + 1;
    const int fixed = p->low == p->high;
    if (!fixed && isfinite(p->high)) e->totals[e->total_count++] = 1.0 / p->high;
    if (!fixed && p->low > 0.0) e->totals[e->total_count++] = -1.0 / p->low;
    e->equal_size = p->equal_count + fixed;
    long most = e->n * p->linear_rows + e->b + e->total_count;
    for (long g = 0; g < p->group_count; g++)
        most += p->groups[g].functions.count * p->groups[g].functions.rows;
    Memory *memory = &e->memory;
    e->row_index = ssm_longs(memory, most);
    e->column = ssm_longs(memory, most);
    e->scale = ssm_doubles(memory, most);
    e->a_first = ssm_longs(memory, p->linear_rows + 1);
    e->a_column = ssm_longs(memory, p->linear_rows * e->states);
    e->a_value = ssm_doubles(memory, p->linear_rows * e->states);
    e->maps = ssm_doubles(memory, e->n * GIVEN * LOCAL);
    e->lengths =
        (Lengths *)(void *)ssm_doubles(memory, e->n * (long)(sizeof(Lengths) / sizeof(double)));
    e->map_slopes = ssm_doubles(memory, e->n * e->w * GIVEN * LOCAL);
    e->by_time = ssm_doubles(memory, e->n * e->w * e->states);
    e->cost_by_z = ssm_doubles(memory, e->n * e->states);
    e->dual_by_z = ssm_doubles(memory, e->n * e->states);
    e->by_z = ssm_doubles(memory, e->n * e->states);
    e->total_border = ssm_doubles(memory, e->size);
    e->total_corner = ssm_doubles(memory, e->b + 1);
    e->parts = (Part *)(void *)ssm_doubles(memory, (p->group_count + 1) *
                                                       (long)(sizeof(Part) / sizeof(double) + 1));
    if (memory->failed) return 0;
    for (long g = 0; g < p->group_count; g++) reserve_part(e, e->parts + g, p->groups + g);
    e->parts[p->group_count].count = e->n;
    e->parts[p->group_count].first = ssm_longs(memory, e->n + 1);
    if (memory->failed) return 0;
    choose_times(e);
    compress_linear_rows(e);
    choose_rows(e);
    return 1;
}

/* ---- Values */

/* Compute z of all elements from the unknowns of a point. */
static ALWAYS_INLINE void compute_states(const Evaluator *e, Point *point, long m)
{
    const double stretch = compute_stretch(e, point->times);
    for (long k = 0; k < e->n; k++) {
        double eta[WIDEST], matrix[GIVEN][LOCAL], *z = point->z + k * (GIVEN * m + 1);
        const double *c = point->c + k * e->stride * m;
        compute_lengths(e, point->times, stretch, k, eta);
        ssm_matrix(e->kind, eta, matrix);
        for (long o = 0; o < GIVEN; o++)
            for (long i = 0; i < m; i++)
                z[state_index(o, m) + i] = matrix[o][0] * c[i] + matrix[o][1] * c[m + i] +
                                           matrix[o][2] * c[2 * m + i] +
                                           matrix[o][3] * c[3 * m + i];
        z[LOCAL * m] = eta[e->duration_index];
    }
}

void ssm_gather(const Evaluator *e, long g, const double *z)
{
    const RowGroup *group = e->program->groups + g;
    const long size = group->functions.size_z;
    for (long member = 0; member < group->functions.count; member++)
        memcpy(e->parts[g].z + member * size, z + group->elements[member] * e->states,
               (size_t)size * sizeof(double));
}

/* Compute z, active rows, equalities and objective of a point from its c and times. */
void ssm_values(Evaluator *e, Point *point)
{
    const Program *p = e->program;
    FOR_COORDINATES(e->m, compute_states(e, point, m))
    double sum = sum_values(point->times, e->b), objective = p->time_weight * sum;
    for (long j = 0; p->even != 0.0 && j < e->b; j++)
        objective += point->times[j] * variance_slope(e, point->times, j) / 2.0;
    for (long k = 0; k < e->n; k++)
        objective +=
            point->z[k * e->states + LOCAL * e->m] * smoothing(e, point->z + k * e->states);
    for (long g = 0; g < p->group_count; g++) {
        const RowGroup *group = p->groups + g;
        const ElementGroup *f = &group->functions;
        Part *part = e->parts + g;
        ssm_gather(e, g, point->z);
        e->failed |= f->values_of(f->context, part->z, part->values, part->cost);
        for (long member = 0; member < part->count; member++)
            for (long a = part->first[member]; a < part->first[member + 1]; a++) {
                const long entry = member * f->rows + e->column[a];
                point->rows[a] = part->values[entry] - group->bound[entry];
            }
        if (f->costs) objective += group->cost_weight * sum_values(part->cost, part->count);
    }
    point->objective = objective;
    const Part *linear = e->parts + p->group_count;
    for (long k = 0; k < e->n; k++)
        for (long a = linear->first[k]; a < linear->first[k + 1]; a++) {
            const double value = linear_value(e, e->column[a], point->z + k * e->states);
            point->rows[a] = (value - p->bound[k * p->linear_rows + e->column[a]]) * e->scale[a];
        }
    double *times = point->rows + e->first_time;
    for (long j = 0; j < e->b; j++) times[j] = 1.0 - point->times[j] / p->least_times[j];
    for (long t = 0; t < e->total_count; t++)
        times[e->b + t] = e->totals[t] * sum - copysign(1.0, e->totals[t]);
    for (long q = 0; q < p->equal_count; q++)
        point->equal[q] =
            point->z[p->equal_at[q] * e->states + p->equal_entry[q]] - p->equal_value[q];
    if (e->equal_size > p->equal_count) point->equal[p->equal_count] = sum - p->low;
}
