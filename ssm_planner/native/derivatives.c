/* First and second derivatives of an optimisation problem (program.c) at one point.
 *
 * All functions are first differentiated by z. The chain rule then gives the derivatives by the
 * unknowns of an element. Those by its four rows c_f .. c_{f+3} use z = (M x I_m) c. The product M
 * x I_m is not computed, because M is the same for each coordinate. Those by times use dz/dtau,
 * where tau are the few times on which the lengths of the element depend, usually one.
 */

#include <string.h>

#include "program.h"

static const double STIFF =
    1e3; /* weight of e'e / 2 in the matrix, without which K is nearly singular */

/* ---- First derivatives */

/* Compute by_c = (M x I)' by_z (4 m) for a gradient by z. map: M of the element. */
static ALWAYS_INLINE void multiply_by_transposed_map(const double *map, const double *by_z,
                                                     double *by_c, long m)
{
    for (long j = 0; j < LOCAL; j++)
        for (long i = 0; i < m; i++) {
            double sum = 0.0;
            for (long o = 0; o < GIVEN; o++)
                sum += map[o * LOCAL + j] * by_z[state_index(o, m) + i];
            by_c[j * m + i] = sum;
        }
}

/* Compute all entries of z = (M x I) c except the duration. map: M of the element. */
static ALWAYS_INLINE void multiply_by_map(const double *map, const double *c, double *z, long m)
{
    for (long o = 0; o < GIVEN; o++)
        for (long i = 0; i < m; i++)
            z[state_index(o, m) + i] = map[o * LOCAL] * c[i] + map[o * LOCAL + 1] * c[m + i] +
                                       map[o * LOCAL + 2] * c[2 * m + i] +
                                       map[o * LOCAL + 3] * c[3 * m + i];
}

/* Compute M of element k, and dM/dtau and dz/dtau for its times. */
static ALWAYS_INLINE void differentiate_map(Evaluator *e, const Point *point, long k, long m)
{
    const Lengths *lengths = e->lengths + k;
    double eta[WIDEST], slope[TERMS][WIDEST];
    compute_lengths(e, point->times, e->stretch, k, eta);
    ssm_matrix(e->kind, eta, (double (*)[LOCAL])(e->maps + k * GIVEN * LOCAL));
    ssm_term_slopes(e->kind, eta, slope);
    for (long x = 0; x < lengths->count; x++) {
        double *map_slope = e->map_slopes + (lengths->first + x) * GIVEN * LOCAL;
        double *by_time = e->by_time + (lengths->first + x) * (GIVEN * m + 1);
        memset(map_slope, 0, GIVEN * LOCAL * sizeof(double));
        for (long t = 0; t < e->terms; t++) {
            double share = 0.0;
            for (long j = 0; j < e->w; j++)
                share += lengths->time_index[j] == x ? lengths->share[j] * slope[t][j] : 0.0;
            for (long j = 0; j < LOCAL; j++)
                map_slope[e->term[t].given * LOCAL + j] += share * e->term[t].row[j];
        }
        multiply_by_map(map_slope, point->c + k * e->stride * m, by_time, m);
        by_time[LOCAL * m] =
            lengths->time_index[e->duration_index] == x ? lengths->share[e->duration_index] : 0.0;
    }
}

/* Compute the maps of all elements, and the gradient of the smoothing term of f by z. */
static ALWAYS_INLINE void differentiate_elements(Evaluator *e, const Point *point, long m)
{
    const double *weight = e->program->smoothing;
    for (long k = 0; k < e->n; k++) {
        const double *z = point->z + k * (GIVEN * m + 1), h = z[LOCAL * m];
        double *by_z = e->cost_by_z + k * (GIVEN * m + 1);
        differentiate_map(e, point, k, m);
        memset(by_z, 0, (size_t)(GIVEN * m + 1) * sizeof(double));
        for (long i = 0; i < m; i++) {
            by_z[2 * m + i] = h * weight[i] * (2.0 * z[2 * m + i] + z[3 * m + i]);
            by_z[3 * m + i] = h * weight[i] * (2.0 * z[3 * m + i] + z[2 * m + i]);
        }
        by_z[LOCAL * m] = smoothing(e, z);
    }
}

/* Compute the derivatives of all functions of elements at a point, which the following functions
 * use.
 *
 * lam, sigma: multipliers and stiffness of the active rows, for the second derivatives. */
void ssm_differentiate(Evaluator *e, const Point *point, const double *lam, const double *sigma)
{
    const Program *p = e->program;
    e->point = point;
    e->stretch = compute_stretch(e, point->times);
    FOR_COORDINATES(e->m, differentiate_elements(e, point, m))
    for (long g = 0; g < p->group_count; g++) {
        const RowGroup *group = p->groups + g;
        const ElementGroup *f = &group->functions;
        Part *part = e->parts + g;
        ssm_gather(e, g, point->z);
        for (long member = 0; member < part->count; member++)
            for (long a = part->first[member]; a < part->first[member + 1]; a++) {
                part->multipliers[member * (f->rows + f->costs) + e->column[a]] = lam[a];
                part->stiffness[member * f->rows + e->column[a]] = sigma[a];
            }
        const Derivatives outputs = {part->jacobian, part->cost, part->hessian};
        e->failed |=
            f->derivatives_of(f->context, part->z, part->multipliers, part->stiffness, &outputs);
        for (long member = 0; member < part->count && f->costs; member++)
            for (long i = 0; i < f->size_z; i++)
                e->cost_by_z[group->elements[member] * e->states + i] +=
                    group->cost_weight * part->cost[member * f->size_z + i];
    }
}

/* Compute the gradient by z of f, plus J' weights of the rows, plus A' equal times `springs` of the
 * equalities of single entries of z. */
static ALWAYS_INLINE void gradient_by_z(const Evaluator *e, const double *weights,
                                        const double *equal, double springs, double *by_z, long m)
{
    const Program *p = e->program;
    const long size = LOCAL * m + 1, states = GIVEN * m + 1;
    memcpy(by_z, e->cost_by_z, (size_t)(e->n * states) * sizeof(double));
    for (long g = 0; g < p->group_count; g++) {
        const Part *part = e->parts + g;
        const long rows = p->groups[g].functions.rows;
        for (long member = 0; member < part->count; member++) {
            double *element_slope = by_z + p->groups[g].elements[member] * states,
                   sum[LOCAL * COORDINATES + 1];
            memcpy(sum, element_slope, (size_t)size * sizeof(double));
            for (long a = part->first[member]; a < part->first[member + 1]; a++) {
                const double *row = part->jacobian + (member * rows + e->column[a]) * size;
                for (long i = 0; i < size; i++) sum[i] += weights[a] * row[i];
            }
            memcpy(element_slope, sum, (size_t)size * sizeof(double));
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

/* Convert a gradient by z to one by the unknowns (c, T), and add the terms that depend on T
 * directly: the rows of the durations with their weights, and the terms of f. */
static ALWAYS_INLINE void pull_back_gradient(const Evaluator *e, const double *by_z,
                                             const double *weights, double *result, long m)
{
    const Program *p = e->program;
    const long states = GIVEN * m + 1;
    double *by_t = result + e->size, total_slope = p->time_weight;
    memset(result, 0, (size_t)(e->size + e->b) * sizeof(double));
    for (long k = 0; k < e->n; k++) {
        const Lengths *lengths = e->lengths + k;
        const double *slope = by_z + k * states, *map = e->maps + k * GIVEN * LOCAL;
        double *element_slope = result + k * e->stride * m, by_c[LOCAL * COORDINATES];
        multiply_by_transposed_map(map, slope, by_c, m);
        for (long i = 0; i < LOCAL * m; i++) element_slope[i] += by_c[i];
        for (long x = 0; x < lengths->count; x++) {
            const double time_slope =
                ssm_dot(e->by_time + (lengths->first + x) * states, slope, states);
            *(lengths->time[x] < e->b ? by_t + lengths->time[x] : &total_slope) += time_slope;
        }
    }
    for (long i = 0; i < e->size; i++)
        if (!p->is_free[i]) result[i] = 0.0;
    const double *times = weights + e->first_time;
    for (long t = 0; t < e->total_count; t++) total_slope += e->totals[t] * times[e->b + t];
    for (long j = 0; j < e->b; j++)
        by_t[j] +=
            total_slope + variance_slope(e, e->point->times, j) - times[j] / p->least_times[j];
}

/* Compute the gradient by (c, T) of f + weights' rows + springs equal' equalities. */
static ALWAYS_INLINE void differentiate_lagrangian(const Evaluator *e, const double *weights,
                                                   const double *equal, double springs,
                                                   double *by_z, double *result, long m)
{
    gradient_by_z(e, weights, equal, springs, by_z, m);
    pull_back_gradient(e, by_z, weights, result, m);
}

/* Compute the gradient of f + lam' rows + nu' equalities by (c, T) (size + b). */
void ssm_dual(Evaluator *e, const double *lam, const double *nu, double *dual)
{
    FOR_COORDINATES(e->m, differentiate_lagrangian(e, lam, nu, 1.0, e->dual_by_z, dual, m))
    if (e->equal_size > e->program->equal_count)
        for (long j = 0; j < e->b; j++) dual[e->size + j] += nu[e->program->equal_count];
}

/* Compute Df + J' weights + STIFF A' e (size + b), the right-hand side of a Newton step. The last
 * term compensates STIFF A' A in the matrix, so that the step is unchanged. */
void ssm_right_side(Evaluator *e, const double *weights, double *right)
{
    FOR_COORDINATES(e->m,
                    differentiate_lagrangian(e, weights, e->point->equal, STIFF, e->by_z, right, m))
}

/* Compute the changes of z (all_dz) and of the rows of the groups (change) along a step (dc, dt).
 * Return the change of the part of f that depends on z. All changes are linear. */
static ALWAYS_INLINE double change_along_step(const Evaluator *e, const double *dc,
                                              const double *dt, double *all_dz, double *change,
                                              long m)
{
    const Program *p = e->program;
    const long size = LOCAL * m + 1, states = GIVEN * m + 1;
    const double sum = sum_values(dt, e->b);
    double slope = 0.0;
    for (long k = 0; k < e->n; k++) {
        const Lengths *lengths = e->lengths + k;
        double *dz = all_dz + k * states;
        multiply_by_map(e->maps + k * GIVEN * LOCAL, dc + k * e->stride * m, dz, m);
        dz[LOCAL * m] = 0.0;
        for (long x = 0; x < lengths->count; x++) {
            const double *by_time = e->by_time + (lengths->first + x) * states;
            const double step = lengths->time[x] < e->b ? dt[lengths->time[x]] : sum;
            for (long i = 0; i < states; i++) dz[i] += by_time[i] * step;
        }
        slope += ssm_dot(e->cost_by_z + k * states, dz, states);
    }
    for (long g = 0; g < p->group_count; g++) {
        const Part *part = e->parts + g;
        const long rows = p->groups[g].functions.rows;
        for (long member = 0; member < part->count; member++) {
            const double *dz = all_dz + p->groups[g].elements[member] * states;
            for (long a = part->first[member]; a < part->first[member + 1]; a++)
                change[a] =
                    ssm_dot(part->jacobian + (member * rows + e->column[a]) * size, dz, size);
        }
    }
    return slope;
}

/* Compute the linear change of the active rows along a step (dc, dt). Return the change of f. */
double ssm_along(Evaluator *e, const double *dc, const double *dt, double *change)
{
    const Program *p = e->program;
    double slope = 0.0, *dz = e->by_z; /* workspace */
    FOR_COORDINATES(e->m, slope = change_along_step(e, dc, dt, dz, change, m))
    const Part *linear = e->parts + p->group_count;
    for (long k = 0; k < e->n; k++)
        for (long a = linear->first[k]; a < linear->first[k + 1]; a++)
            change[a] = linear_value(e, e->column[a], dz + k * e->states) * e->scale[a];
    const double sum = sum_values(dt, e->b);
    for (long j = 0; j < e->b; j++) {
        change[e->first_time + j] = -dt[j] / p->least_times[j];
        slope += (p->time_weight + variance_slope(e, e->point->times, j)) * dt[j];
    }
    for (long t = 0; t < e->total_count; t++) change[e->first_time + e->b + t] = e->totals[t] * sum;
    return slope;
}

/* ---- Second derivatives */

/* Compute the matrix h ((5 m + 1) x (5 m + 1), all entries) of element k: the Hessian of f + lam'
 * rows by z, plus J' diag(sigma) J + STIFF A' A. */
static ALWAYS_INLINE void hessian_by_z(const Evaluator *e, long k, const double *sigma, double *h,
                                       long m)
{
    const Program *p = e->program;
    const long size = GIVEN * m + 1, width = LOCAL * m + 1;
    const double *z = e->point->z + k * size;
    memset(h, 0, (size_t)(size * size) * sizeof(double));
    for (long i = 0; i < m; i++) {
        const double weight = p->smoothing[i], length = z[LOCAL * m];
        const long first = 2 * m + i, last = 3 * m + i, duration = LOCAL * m;
        h[first * size + first] = h[last * size + last] = 2.0 * weight * length;
        h[last * size + first] = h[first * size + last] = weight * length;
        h[duration * size + first] = h[first * size + duration] =
            weight * (2.0 * z[first] + z[last]);
        h[duration * size + last] = h[last * size + duration] = weight * (2.0 * z[last] + z[first]);
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
        if (p->equal_at[q] == k) h[p->equal_entry[q] * size + p->equal_entry[q]] += STIFF;
    for (long g = 0; g < p->group_count; g++) {
        const Part *part = e->parts + g;
        for (long index = part->member_first[k]; index < part->member_first[k + 1]; index++) {
            const double *member_hessian = part->hessian + part->member[index] * width * width;
            for (long i = 0; i < width; i++)
                for (long j = 0; j < width; j++) h[i * size + j] += member_hessian[i * width + j];
        }
    }
}

/* Add (M x I)' h (M x I) of element k to the band. Entries above the diagonal of a panel are not
 * read. */
static ALWAYS_INLINE void add_to_band(const Evaluator *e, System *system, long k, const double *h,
                                      long m)
{
    const long size = GIVEN * m + 1, stride = e->stride, height = LOCAL * m;
    const double *map = e->maps + k * GIVEN * LOCAL;
    const unsigned char *is_free = e->program->is_free + k * stride * m;
    const int all_free = memchr(is_free, 0, (size_t)height) == NULL;
    double *band = system->band + k * stride * m * height;
    for (long i = 0; i < m; i++) {
        double half[GIVEN][LOCAL * COORDINATES]; /* h (M x I), the rows of coordinate i */
        for (long o = 0; o < GIVEN; o++)
            multiply_by_transposed_map(map, h + (state_index(o, m) + i) * size, half[o], m);
        for (long l = 0; l < LOCAL; l++) {
            const long column = l * m + i, panel = l / stride * stride * m;
            double sum[LOCAL * COORDINATES] = {0.0};
            for (long o = 0; o < GIVEN; o++)
                for (long row = 0; row < height; row++)
                    sum[row] += map[o * LOCAL + l] * half[o][row];
            for (long row = 0; row < height && !all_free; row++)
                sum[row] = is_free[row] && is_free[column] ? sum[row] : 0.0;
            for (long row = panel; row < height; row++)
                band[column * height + row - panel] += sum[row];
        }
    }
}

/* Compute the second derivatives of by_z' z by the lengths eta of element k, with constant by_z. */
static ALWAYS_INLINE void curvature_of_lengths(const Evaluator *e, long k, const double *by_z,
                                               const double *c, double curvature[WIDEST][WIDEST],
                                               long m)
{
    double eta[WIDEST], weight[TERMS] = {0.0};
    for (long t = 0; t < e->terms; t++)
        for (long i = 0; i < m; i++)
            for (long j = 0; j < LOCAL; j++)
                weight[t] +=
                    by_z[state_index(e->term[t].given, m) + i] * e->term[t].row[j] * c[j * m + i];
    compute_lengths(e, e->point->times, e->stretch, k, eta);
    ssm_term_curvature(e->kind, eta, weight, curvature);
}

/* Add the second derivatives of element k by (c, tau) to the border, and those by tau to the
 * corner. If tau is the sum of all durations, add them to total_border and total_corner instead. */
static ALWAYS_INLINE void add_to_border(const Evaluator *e, System *system, long k, const double *h,
                                        long m)
{
    const Lengths *lengths = e->lengths + k;
    const long size = GIVEN * m + 1, first = k * e->stride * m, count = lengths->count, b = e->b;
    const double *map = e->maps + k * GIVEN * LOCAL, *by_z = e->dual_by_z + k * size,
                 *c = e->point->c + first;
    const double *by_time = e->by_time + lengths->first * size;
    const unsigned char *is_free = e->program->is_free + first;
    double half[WIDEST][GIVEN * COORDINATES + 1], curvature[WIDEST][WIDEST],
        time_curvature[WIDEST][WIDEST] = {{0.0}};
    curvature_of_lengths(e, k, by_z, c, curvature, m);
    for (long i = 0; i < e->w; i++)
        for (long j = 0; j < e->w; j++)
            if (lengths->time_index[i] >= 0 && lengths->time_index[j] >= 0)
                time_curvature[lengths->time_index[i]][lengths->time_index[j]] +=
                    lengths->share[i] * lengths->share[j] * curvature[i][j];
    for (long x = 0; x < count; x++) {
        const double *map_slope = e->map_slopes + (lengths->first + x) * GIVEN * LOCAL;
        double *border = (lengths->time[x] < b ? system->border + lengths->time[x] * system->padded
                                               : e->total_border) +
                         first;
        for (long r = 0; r < size; r++) half[x][r] = 0.0;
        for (long q = 0; q < size; q++)
            for (long r = 0; r < size; r++) half[x][r] += by_time[x * size + q] * h[q * size + r];
        for (long j = 0; j < LOCAL; j++)
            for (long i = 0; i < m; i++) {
                double sum = 0.0;
                for (long o = 0; o < GIVEN; o++)
                    sum += map[o * LOCAL + j] * half[x][state_index(o, m) + i] +
                           map_slope[o * LOCAL + j] * by_z[state_index(o, m) + i];
                border[j * m + i] += is_free[j * m + i] ? sum : 0.0;
            }
    }
    for (long x = 0; x < count; x++)
        for (long y = 0; y < count; y++) {
            const long time = lengths->time[x], other = lengths->time[y];
            const double value = time_curvature[x][y] + ssm_dot(by_time + x * size, half[y], size);
            if (other < b && time < b)
                system->corner[time * system->columns + other] += value;
            else if (other == b)
                e->total_corner[time] += value;
        }
}

/* Set the columns of the border and the rows of the corner that belong to the equalities. */
static void add_equalities(const Evaluator *e, System *system)
{
    const Program *p = e->program;
    const long m = e->m, columns = system->columns;
    for (long q = 0; q < p->equal_count; q++) {
        const long k = p->equal_at[q], entry_index = p->equal_entry[q],
                   state = entry_index - (entry_index > LOCAL * m), o = state / m, i = state % m;
        const int is_length = entry_index == LOCAL * m;
        double *row = system->corner + (e->b + q) * columns;
        for (long j = 0; !is_length && j < LOCAL; j++) {
            const long unknown = (k * e->stride + j) * m + i;
            if (p->is_free[unknown])
                system->border[(e->b + q) * system->padded + unknown] =
                    e->maps[k * GIVEN * LOCAL + o * LOCAL + j];
        }
        const Lengths *lengths = e->lengths + k;
        for (long x = 0; x < lengths->count; x++) {
            const double slope = e->by_time[(lengths->first + x) * e->states + entry_index];
            for (long b = 0; b < e->b; b++)
                if (lengths->time[x] == e->b || lengths->time[x] == b) row[b] += slope;
        }
    }
    for (long b = 0; e->equal_size > p->equal_count && b < e->b; b++)
        system->corner[(e->b + p->equal_count) * columns + b] = 1.0;
    for (long q = e->b; q < columns; q++)
        for (long b = 0; b < e->b; b++)
            system->corner[b * columns + q] = system->corner[q * columns + b];
}

/* Add the second derivatives of all elements to the system. */
static ALWAYS_INLINE void add_elements(const Evaluator *e, System *system, const double *sigma,
                                       long m)
{
    double h[(GIVEN * COORDINATES + 1) * (GIVEN * COORDINATES + 1)];
    for (long k = 0; k < e->n; k++) {
        hessian_by_z(e, k, sigma, h, m);
        add_to_band(e, system, k, h, m);
        add_to_border(e, system, k, h, m);
    }
}

/* Compute the matrix of a Newton step: the Hessian of f + lam' rows + nu' equalities, plus J'
 * diag(sigma) J + STIFF A' A with the equalities of single entries of z. lam and sigma are those
 * of ssm_differentiate, nu is that of ssm_dual. */
void ssm_newton_matrix(Evaluator *e, System *system, const double *sigma)
{
    const Program *p = e->program;
    const long columns = system->columns;
    memset(system->band, 0, (size_t)(e->size * system->height) * sizeof(double));
    memset(system->border, 0, (size_t)(system->padded * columns) * sizeof(double));
    memset(system->corner, 0, (size_t)(columns * columns) * sizeof(double));
    memset(e->total_border, 0, (size_t)e->size * sizeof(double));
    memset(e->total_corner, 0, (size_t)(e->b + 1) * sizeof(double));
    FOR_COORDINATES(e->m, add_elements(e, system, sigma, m))
    if (p->stretched_from > 0.0 && e->kind == HERMITE && e->b > 1)
        for (long b = 0; b < e->b; b++)
            for (long i = 0; i < e->size; i++)
                system->border[b * system->padded + i] += e->total_border[i];
    const double *times = sigma + e->first_time;
    double total_curvature = e->total_corner[e->b];
    for (long t = 0; t < e->total_count; t++)
        total_curvature += times[e->b + t] * e->totals[t] * e->totals[t];
    for (long i = 0; i < e->b; i++)
        for (long j = 0; j < e->b; j++) {
            const double scale = p->least_times[i] * p->least_times[j],
                         identity = i == j ? 1.0 : 0.0, b = (double)e->b;
            system->corner[i * columns + j] += total_curvature + e->total_corner[i] +
                                               e->total_corner[j] + identity * times[i] / scale +
                                               2.0 * p->even / b * (identity - 1.0 / b) / scale;
        }
    add_equalities(e, system);
}
