/* Solver of the linear system of a Newton step: a positive definite band matrix with a border.
 *
 *     [ K   P ] [ dc ]     [ -r_c ]        P = [B  A_c'],   Q = [ C    A_T' ]
 *     [ P'  Q ] [ dT ]  =  [ -r_T ]                             [ A_T   0   ]
 *               [ dv ]     [ -e   ]
 *
 * dc are the steps of the unknowns of the spline, dT those of the b durations, and dv those of the
 * multipliers of the q equality constraints. K is banded, because an element couples only four
 * rows of unknowns. The border P has one column for each duration and for each equality.
 *
 * Let K = L L' be the Cholesky factorisation, and Y = L^-1 P. The Schur complement is S = Q - Y'Y.
 * The inertia (the numbers of positive, negative and zero eigenvalues) is that of a minimum if K
 * is positive definite and S has b positive and q negative eigenvalues. Otherwise delta I is added
 * to K and C. delta grows until the inertia is correct (Waechter and Biegler, Math. Program. 106,
 * 2006, section 3.1).
 *
 * S is small and dense. It is factorised as R S R' = L D L' with a permutation R from complete
 * diagonal pivoting. D has blocks of one or two rows (Bunch and Parlett, SIAM J. Numer. Anal. 8,
 * 1971). By Sylvester's law, D has the same inertia as S.
 */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "interior.h"

/* First positive delta if no earlier system needed one, and bounds of delta. */
static const double FIRST_DELTA = 1e-4, LEAST_DELTA = 1e-20, LARGEST_DELTA = 1e20;
/* Factors by which delta grows within a system: without and with an earlier delta. An earlier
 * delta is divided by DECREASE for the next system. */
static const double FIRST_GROWTH = 100.0, GROWTH = 8.0, DECREASE = 3.0;
/* Eigenvalues of S must exceed this value to count as positive. It is also added to the
 * diagonal of K. */
static const double LEAST_EIGENVALUE = 1e-12;
/* (1 + sqrt 17) / 8, which minimises the bound of the growth of entries (Bunch and Parlett). */
static const double PIVOT_RATIO = 0.6403882032022076;

struct MemoryBlock {
    struct MemoryBlock *previous;
    /* `values` continues to the end of the allocated memory. */
    double values[1];
};

double *ssm_doubles(Memory *memory, long count)
{
    MemoryBlock *block =
        calloc(1, sizeof(MemoryBlock) + (size_t)(count > 0 ? count : 1) * sizeof(double));
    if (block == NULL) {
        memory->failed = 1;
        return NULL;
    }
    block->previous = memory->last;
    memory->last = block;
    return block->values;
}

long *ssm_longs(Memory *memory, long count) { return (long *)(void *)ssm_doubles(memory, count); }

SSM_API void ssm_release(Memory *memory)
{
    while (memory->last != NULL) {
        MemoryBlock *block = memory->last;
        memory->last = block->previous;
        free(block);
    }
}

/* Allocate a system.
 *
 * size: number of unknowns c. columns: number of durations and equality constraints. pairs: number
 * of coordinates. stride: rows of unknowns from one element to the next, 1 or 2. Return 0 if a
 * size is not supported or there is not enough memory. Otherwise return 1.
 */
SSM_API int ssm_system_new(System *system, Memory *memory, long size, long columns, long pairs,
                           long stride)
{
    if (pairs < 1 || pairs > COORDINATES || stride < 1 || stride > 2) return 0;
    system->size = size;
    system->width = stride * pairs;
    system->height = LOCAL * pairs;
    system->columns = columns;
    system->padded = size + system->height - system->width;
    system->last_delta = 0.0;
    system->band = ssm_doubles(memory, system->padded * system->height);
    system->factor = ssm_doubles(memory, system->padded * system->height);
    system->border = ssm_doubles(memory, system->padded * columns);
    system->solved = ssm_doubles(memory, system->padded * columns);
    system->right = ssm_doubles(memory, system->padded);
    system->corner = ssm_doubles(memory, columns * columns);
    system->schur = ssm_doubles(memory, columns * columns);
    system->shifted = ssm_doubles(memory, columns * columns);
    system->pivots = ssm_longs(memory, 2 * columns);
    return !memory->failed;
}

/* ---- The band. A panel is a group of neighbouring columns of K or L that are stored from the
 * same row. The functions for a panel are inlined with constant width and height (see PANELS), so
 * that the compiler can unroll the loops. Rows after the last unknown are zero. Entries above the
 * diagonal are not read. */

#define UNROLLED _Pragma("GCC unroll 8")

/* Subtract from `target` (length) the sum over j of share[j share_stride] times column j of
 * `source`. The columns are `height` numbers apart in memory. */
static ALWAYS_INLINE void subtract_columns(double *target, const double *source,
                                           const double *share, long share_stride, long columns,
                                           long height, long length)
{
    double sum[LOCAL * COORDINATES];
    for (long i = 0; i < length; i++) sum[i] = target[i];
    for (long j = 0; j < columns; j++)
        for (long i = 0; i < length; i++)
            sum[i] -= share[j * share_stride] * source[j * height + i];
    for (long i = 0; i < length; i++) target[i] = sum[i];
}

/* Compute the Cholesky factor L of K + delta I, with reciprocals on its diagonal. Rows of unknowns
 * that are not free become rows of the identity. Return 0 if the matrix is not positive definite,
 * otherwise 1.
 */
static ALWAYS_INLINE int factorise_band(const System *system, const unsigned char *is_free,
                                        double delta, long width, long height)
{
    memcpy(system->factor, system->band, (size_t)(system->size * height) * sizeof(double));
    for (long first = 0; first < system->size; first += width) {
        double *panel = system->factor + first * height;
        for (long c = 0; c < width; c++) {
            double *column = panel + c * height;
            column[c] = is_free[first + c] ? column[c] + delta + LEAST_EIGENVALUE : 1.0;
            for (long offset = width; offset < height && offset <= first; offset += width)
                subtract_columns(column, panel - offset * height + offset,
                                 panel - offset * height + offset + c, height, width, height,
                                 height - offset);
            subtract_columns(column, panel, panel + c, height, c, height, height);
            if (!(column[c] > 0.0) || !isfinite(column[c])) return 0;
            const double inverse = 1.0 / sqrt(column[c]);
            for (long i = 0; i < height; i++) column[i] *= inverse;
            column[c] = inverse;
        }
    }
    return 1;
}

/* Replace x (padded) by L^-1 x. */
static ALWAYS_INLINE void solve_forward(const System *system, double *x, long width, long height)
{
    const double *panel = system->factor;
    for (long first = 0; first < system->size;
         first += width, panel += width * height, x += width) {
        double solution[2 * COORDINATES];
        UNROLLED for (long c = 0; c < width; c++)
        {
            double sum = x[c];
            UNROLLED for (long i = 0; i < c; i++) sum -= solution[i] * panel[i * height + c];
            x[c] = solution[c] = sum * panel[c * height + c];
        }
        subtract_columns(x + width, panel + width, solution, 1, width, height, height - width);
    }
}

/* Replace x (padded) by L'^-1 x. */
static ALWAYS_INLINE void solve_backward(const System *system, double *x, long width, long height)
{
    for (long first = system->size - width; first >= 0; first -= width) {
        const double *panel = system->factor + first * height, *later = x + first + width;
        double solution[2 * COORDINATES];
        UNROLLED for (long c = width - 1; c >= 0; c--)
        {
            double sum = x[first + c] - ssm_dot(panel + c * height + width, later, height - width);
            UNROLLED for (long i = width - 1; i > c; i--) sum -=
                solution[i] * panel[c * height + i];
            x[first + c] = solution[c] = sum * panel[c * height + c];
        }
    }
}

/* The functions for one width and height of the panels. */
typedef struct {
    int (*factor)(const System *system, const unsigned char *is_free, double delta);
    void (*solve_forward)(const System *system, double *x),
        (*solve_backward)(const System *system, double *x);
} Panels;

#define PANELS(width, height)                                                                      \
    static int factor_##width##_##height(const System *system, const unsigned char *is_free,       \
                                         double delta)                                             \
    { return factorise_band(system, is_free, delta, width, height); }                              \
    static void forward_##width##_##height(const System *system, double *x)                        \
    { solve_forward(system, x, width, height); }                                                   \
    static void backward_##width##_##height(const System *system, double *x)                       \
    { solve_backward(system, x, width, height); }
PANELS(1, 4)
PANELS(2, 4)
PANELS(2, 8)
PANELS(4, 8)
PANELS(3, 12)
PANELS(6, 12)
PANELS(4, 16)
PANELS(8, 16)

#define PANEL_FUNCTIONS(width, height)                                                             \
    {factor_##width##_##height, forward_##width##_##height, backward_##width##_##height}
static const Panels PANELS_BY_SIZE[COORDINATES][2] = {
    {PANEL_FUNCTIONS(1, 4), PANEL_FUNCTIONS(2, 4)},
    {PANEL_FUNCTIONS(2, 8), PANEL_FUNCTIONS(4, 8)},
    {PANEL_FUNCTIONS(3, 12), PANEL_FUNCTIONS(6, 12)},
    {PANEL_FUNCTIONS(4, 16), PANEL_FUNCTIONS(8, 16)},
};

/* Return the functions for the panels of a system. */
static const Panels *select_panels(const System *system)
{
    const long pairs = system->height / LOCAL;
    return &PANELS_BY_SIZE[pairs - 1][system->width / pairs - 1];
}

/* ---- The border */

/* Compute all entries of S = Q - Y'Y, and add delta to the first `blocks` diagonal entries. Return
 * 0 if an entry is not finite, otherwise 1. */
static int schur_complement(System *system, double delta, long blocks)
{
    const long n = system->columns;
    double *schur = system->schur;
    for (long i = 0; i < n; i++)
        for (long j = 0; j <= i; j++) {
            const double *y = system->solved + i * system->padded,
                         *other_column = system->solved + j * system->padded;
            const double corner = system->corner[i * n + j] + (i == j && i < blocks ? delta : 0.0);
            schur[i * n + j] = schur[j * n + i] = corner - ssm_dot(y, other_column, system->size);
            if (!isfinite(schur[i * n + j])) return 0;
        }
    return 1;
}

/* Factorise S. Return 1 if it is regular and has `blocks` eigenvalues above LEAST_EIGENVALUE,
 * otherwise 0.
 */
static int has_inertia_of_minimum(System *system, long blocks)
{
    const long n = system->columns;
    long inertia[3], shifted[3];
    memcpy(system->shifted, system->schur, (size_t)(n * n) * sizeof(double));
    for (long i = 0; i < n; i++) system->shifted[i * n + i] -= LEAST_EIGENVALUE;
    ssm_symmetric_factor(system->shifted, n, system->pivots + n, shifted);
    return ssm_symmetric_factor(system->schur, n, system->pivots, inertia) &&
           shifted[0] == blocks && inertia[0] == blocks;
}

/* Factorise the system, and increase delta until it has the inertia of a minimum.
 *
 * is_free: 0 for unknowns c whose step is 0 (size). blocks: number of durations. Return 0 if no
 * allowed delta is large enough or a number is not finite. Otherwise return 1.
 */
SSM_API int ssm_factorise(System *system, const unsigned char *is_free, long blocks)
{
    const Panels *panels = select_panels(system);
    double delta = 0.0;
    while (delta < LARGEST_DELTA) {
        if (panels->factor(system, is_free, delta)) {
            memcpy(system->solved, system->border,
                   (size_t)(system->padded * system->columns) * sizeof(double));
            for (long i = 0; i < system->columns; i++)
                panels->solve_forward(system, system->solved + i * system->padded);
            if (!schur_complement(system, delta, blocks)) return 0;
            if (has_inertia_of_minimum(system, blocks)) {
                system->last_delta = delta > 0.0 ? delta : system->last_delta;
                return 1;
            }
        }
        if (delta == 0.0)
            delta = system->last_delta > 0.0 ? fmax(system->last_delta / DECREASE, LEAST_DELTA)
                                             : FIRST_DELTA;
        else
            delta *= system->last_delta > 0.0 ? GROWTH : FIRST_GROWTH;
    }
    return 0;
}

/* Replace the right-hand side by the solution: `right` (size) by dc, `rest` (columns) by (dT, dv).
 * The system must be factorised. */
SSM_API void ssm_solve_factors(const System *system, double *right, double *rest)
{
    const size_t size = (size_t)system->size * sizeof(double);
    double *x = system->right;
    memset(x, 0, (size_t)system->padded * sizeof(double));
    memcpy(x, right, size);
    select_panels(system)->solve_forward(system, x);
    for (long i = 0; i < system->columns; i++)
        rest[i] -= ssm_dot(system->solved + i * system->padded, x, system->size);
    ssm_symmetric_solve(system->schur, system->columns, system->pivots, rest);
    memset(x + system->size, 0, (size_t)(system->padded - system->size) * sizeof(double));
    for (long i = 0; i < system->columns; i++) {
        const double *column = system->solved + i * system->padded;
        for (long k = 0; k < system->size; k++) x[k] -= column[k] * rest[i];
    }
    select_panels(system)->solve_backward(system, x);
    memcpy(right, x, size);
}

/* Exchange rows i and j, and columns i and j, of the matrix a (n x n). */
static void exchange_rows_and_columns(double *a, long n, long i, long j)
{
    for (long k = 0; i != j && k < n; k++) {
        const double row = a[i * n + k];
        a[i * n + k] = a[j * n + k];
        a[j * n + k] = row;
    }
    for (long k = 0; i != j && k < n; k++) {
        const double column = a[k * n + i];
        a[k * n + i] = a[k * n + j];
        a[k * n + j] = column;
    }
}

/* Choose the next pivot of a (n x n) in the rows and columns from k on.
 *
 * diagonal_row receives the index of the largest diagonal entry, (row, column) the position of the
 * largest entry below the diagonal. Return the absolute value of the diagonal entry if it is a
 * pivot of one row. Return minus the absolute value of the other entry if the pivot has two rows.
 */
static double find_pivot(const double *a, long n, long k, long *diagonal_row, long *row,
                         long *column)
{
    double diagonal = -1.0, off_diagonal = -1.0;
    for (long i = k; i < n; i++) {
        if (fabs(a[i * n + i]) > diagonal) {
            diagonal = fabs(a[i * n + i]);
            *diagonal_row = i;
        }
        for (long j = k; j < i; j++)
            if (fabs(a[i * n + j]) > off_diagonal) {
                off_diagonal = fabs(a[i * n + j]);
                *row = i;
                *column = j;
            }
    }
    return diagonal >= PIVOT_RATIO * off_diagonal ? diagonal : -off_diagonal;
}

/* Eliminate row and column k of the symmetric matrix a (n x n). Column k receives the entries of
 * L. */
static void eliminate_one(double *a, long n, long k)
{
    const double d = a[k * n + k];
    for (long i = k + 1; i < n; i++) {
        const double share = a[i * n + k] / d;
        for (long j = k + 1; j <= i; j++) a[j * n + i] = a[i * n + j] -= share * a[k * n + j];
    }
    for (long i = k + 1; i < n; i++) a[i * n + k] /= d;
}

/* Eliminate rows and columns k and k + 1 in the same way, with a block of two rows of D. */
static void eliminate_two(double *a, long n, long k)
{
    const double d00 = a[k * n + k], d10 = a[(k + 1) * n + k], d11 = a[(k + 1) * n + k + 1];
    const double determinant = d00 * d11 - d10 * d10;
    for (long i = k + 2; i < n; i++) {
        const double x = a[i * n + k], y = a[i * n + k + 1];
        const double first = (d11 * x - d10 * y) / determinant,
                     second = (d00 * y - d10 * x) / determinant;
        for (long j = k + 2; j <= i; j++)
            a[j * n + i] = a[i * n + j] -= first * a[k * n + j] + second * a[(k + 1) * n + j];
        a[i * n + k] = first;
        a[i * n + k + 1] = second;
    }
}

/* Factorise a symmetric matrix. Replace the lower triangle of a (n x n, all entries given) by D on
 * the diagonal, and L below it.
 *
 * pivots: index i with which each row was exchanged (n), stored as -i - 1 if the block of D has
 * two rows. inertia: numbers of positive, negative and zero eigenvalues. Return 0 if a is
 * singular, otherwise 1.
 */
SSM_API int ssm_symmetric_factor(double *a, long n, long *pivots, long inertia[3])
{
    inertia[0] = inertia[1] = inertia[2] = 0;
    for (long k = 0; k < n;) {
        long diagonal_row = k, row = k, column = k;
        const double pivot = find_pivot(a, n, k, &diagonal_row, &row, &column);
        if (pivot == 0.0) {
            inertia[2] = n - k;
            return 0;
        }
        if (pivot > 0.0) {
            exchange_rows_and_columns(a, n, k, diagonal_row);
            pivots[k] = diagonal_row;
            inertia[a[k * n + k] > 0.0 ? 0 : 1]++;
            eliminate_one(a, n, k);
            k += 1;
        } else {
            exchange_rows_and_columns(a, n, k, column);
            exchange_rows_and_columns(a, n, k + 1, row);
            pivots[k] = -column - 1;
            pivots[k + 1] = -row - 1;
            inertia[0]++;
            inertia[1]++;
            eliminate_two(a, n, k);
            k += 2;
        }
    }
    return 1;
}

/* Exchange entries i and j of x. */
static void swap(double *x, long i, long j)
{
    const double value = x[i];
    x[i] = x[j];
    x[j] = value;
}

/* Replace x (n) by the solution of the system whose factors ssm_symmetric_factor computed. */
SSM_API void ssm_symmetric_solve(const double *a, long n, const long *pivots, double *x)
{
    for (long k = 0; k < n; k++) swap(x, k, pivots[k] < 0 ? -pivots[k] - 1 : pivots[k]);
    for (long k = 0, step; k < n; k += step) {
        step = pivots[k] < 0 ? 2 : 1;
        for (long i = k + step; i < n; i++)
            for (long j = k; j < k + step; j++) x[i] -= a[i * n + j] * x[j];
        if (step == 2) {
            const double d00 = a[k * n + k], d10 = a[(k + 1) * n + k], d11 = a[(k + 1) * n + k + 1];
            const double determinant = d00 * d11 - d10 * d10, first = x[k], second = x[k + 1];
            x[k] = (d11 * first - d10 * second) / determinant;
            x[k + 1] = (d00 * second - d10 * first) / determinant;
        } else {
            x[k] /= a[k * n + k];
        }
    }
    for (long k = n - 1, first; k >= 0; k = first - 1) {
        first = pivots[k] < 0 ? k - 1 : k;
        for (long i = k + 1; i < n; i++)
            for (long j = first; j <= k; j++) x[j] -= a[i * n + j] * x[i];
    }
    for (long k = n - 1; k >= 0; k--) swap(x, k, pivots[k] < 0 ? -pivots[k] - 1 : pivots[k]);
}
