/* The Newton system: a positive definite band with a border.
 *
 *     [ K   P ] [ dc ]     [ -r_c ]        P = [B  A_c'],   Q = [ C    A_T' ]
 *     [ P'  Q ] [ dT ]  =  [ -r_T ]                             [ A_T   0   ]
 *               [ dv ]     [ -e   ]
 *
 * K is block-banded, for an element couples four rows of unknowns; the border holds the b times and the q equality
 * constraints. With K = L L' and Y = L^-1 P the Schur complement is S = Q - Y'Y. The whole has the inertia of a minimum where
 * K is positive definite and S has b positive and q negative eigenvalues. Where it has not, delta I is added to K and C, delta
 * growing as in Ipopt (Waechter and Biegler, Math. Program. 106, 2006, section 3.1).
 *
 * S is small: P S P' = L D L' with complete diagonal pivoting, D of blocks of one and two rows (Bunch and Parlett, SIAM J.
 * Numer. Anal. 8, 1971), whose signs are those of the eigenvalues (Sylvester).
 */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "interior.h"

static const double FIRST = 1e-4, LEAST = 1e-20, MOST = 1e20; /* delta: where none was needed before, and its bounds */
static const double UP_FIRST = 100.0, UP = 8.0, DOWN = 3.0;   /* its growth, and fall from one iteration to the next */
static const double POSITIVE = 1e-12;                         /* an eigenvalue of S below this is none */
static const double PIVOT = 0.6403882032022076;               /* (1 + sqrt 17) / 8: bounds the growth of entries alike */

struct MemoryBlock {
    struct MemoryBlock *before;
    double values[1];
};

double *ssm_doubles(Memory *memory, long count)
{
    MemoryBlock *block = calloc(1, sizeof(MemoryBlock) + (size_t)(count > 0 ? count : 1) * sizeof(double));
    if (block == NULL) {
        memory->failed = 1;
        return NULL;
    }
    block->before = memory->last;
    memory->last = block;
    return block->values;
}

long *ssm_longs(Memory *memory, long count)
{
    return (long *)(void *)ssm_doubles(memory, count);
}

SSM_API void ssm_release(Memory *memory)
{
    while (memory->last != NULL) {
        MemoryBlock *block = memory->last;
        memory->last = block->before;
        free(block);
    }
}

SSM_API int ssm_system_new(System *system, Memory *memory, long size, long columns, long pairs, long stride)
{
    if (pairs < 1 || pairs > COORDINATES || stride < 1 || stride > 2)
        return 0;
    system->size = size;
    system->wide = stride * pairs;
    system->high = LOCAL * pairs;
    system->columns = columns;
    system->padded = size + system->high - system->wide;
    system->last = 0.0;
    system->band = ssm_doubles(memory, system->padded * system->high);
    system->factor = ssm_doubles(memory, system->padded * system->high);
    system->border = ssm_doubles(memory, system->padded * columns);
    system->solved = ssm_doubles(memory, system->padded * columns);
    system->right = ssm_doubles(memory, system->padded);
    system->corner = ssm_doubles(memory, columns * columns);
    system->schur = ssm_doubles(memory, columns * columns);
    system->shifted = ssm_doubles(memory, columns * columns);
    system->pivots = ssm_longs(memory, 2 * columns);
    return !memory->failed;
}

/* ---- the band, panel by panel. Widths and heights are constants where these bodies are inlined (PANELS). Rows beyond the
 * last unknown are zero; what stands above the diagonal of a panel of L is not read. */

#define UNROLLED _Pragma("GCC unroll 8")

/* to -= the sum over columns j of share_j from_j; shares are `apart` */
static ALWAYS_INLINE void subtract(double *to, const double *from, const double *share, long apart, long columns, long high,
                                   long length)
{
    double sum[LOCAL * COORDINATES];
    for (long i = 0; i < length; i++)
        sum[i] = to[i];
    for (long j = 0; j < columns; j++)
        for (long i = 0; i < length; i++)
            sum[i] -= share[j * apart] * from[j * high + i];
    for (long i = 0; i < length; i++)
        to[i] = sum[i];
}

/* L of K + delta I, with the reciprocals of its diagonal; 0 where that is not positive definite */
static ALWAYS_INLINE int factor_of(const System *system, const unsigned char *is_free, double delta, long wide, long high)
{
    memcpy(system->factor, system->band, (size_t)(system->size * high) * sizeof(double));
    for (long first = 0; first < system->size; first += wide) {
        double *panel = system->factor + first * high;
        for (long c = 0; c < wide; c++) {
            double *column = panel + c * high;
            column[c] = is_free[first + c] ? column[c] + delta + POSITIVE : 1.0;
            for (long off = wide; off < high && off <= first; off += wide)
                subtract(column, panel - off * high + off, panel - off * high + off + c, high, wide, high, high - off);
            subtract(column, panel, panel + c, high, c, high, high);
            if (!(column[c] > 0.0) || !isfinite(column[c]))
                return 0;
            const double over = 1.0 / sqrt(column[c]);
            for (long i = 0; i < high; i++)
                column[i] *= over;
            column[c] = over;
        }
    }
    return 1;
}

/* x (padded) becomes L^-1 x */
static ALWAYS_INLINE void forward(const System *system, double *x, long wide, long high)
{
    const double *panel = system->factor;
    for (long first = 0; first < system->size; first += wide, panel += wide * high, x += wide) {
        double own[2 * COORDINATES];
        UNROLLED for (long c = 0; c < wide; c++)
        {
            double sum = x[c];
            UNROLLED for (long i = 0; i < c; i++) sum -= own[i] * panel[i * high + c];
            x[c] = own[c] = sum * panel[c * high + c];
        }
        subtract(x + wide, panel + wide, own, 1, wide, high, high - wide);
    }
}

/* x (padded) becomes L'^-1 x */
static ALWAYS_INLINE void backward(const System *system, double *x, long wide, long high)
{
    for (long first = system->size - wide; first >= 0; first -= wide) {
        const double *panel = system->factor + first * high, *later = x + first + wide;
        double own[2 * COORDINATES];
        UNROLLED for (long c = wide - 1; c >= 0; c--)
        {
            double sum = x[first + c] - ssm_dot(panel + c * high + wide, later, high - wide);
            UNROLLED for (long i = wide - 1; i > c; i--) sum -= own[i] * panel[c * high + i];
            x[first + c] = own[c] = sum * panel[c * high + c];
        }
    }
}

typedef struct {
    int (*factor)(const System *system, const unsigned char *is_free, double delta);
    void (*forward)(const System *system, double *x), (*backward)(const System *system, double *x);
} Panels;

#define PANELS(wide, high)                                                                                \
    static int factor_##wide##_##high(const System *system, const unsigned char *is_free, double delta)   \
    {                                                                                                     \
        return factor_of(system, is_free, delta, wide, high);                                             \
    }                                                                                                     \
    static void forward_##wide##_##high(const System *system, double *x) { forward(system, x, wide, high); } \
    static void backward_##wide##_##high(const System *system, double *x) { backward(system, x, wide, high); }
PANELS(1, 4)
PANELS(2, 4)
PANELS(2, 8)
PANELS(4, 8)
PANELS(3, 12)
PANELS(6, 12)
PANELS(4, 16)
PANELS(8, 16)

#define OF_SIZES(wide, high) {factor_##wide##_##high, forward_##wide##_##high, backward_##wide##_##high}
static const Panels BY_SIZES[COORDINATES][2] = {
    {OF_SIZES(1, 4), OF_SIZES(2, 4)},
    {OF_SIZES(2, 8), OF_SIZES(4, 8)},
    {OF_SIZES(3, 12), OF_SIZES(6, 12)},
    {OF_SIZES(4, 16), OF_SIZES(8, 16)},
};

static const Panels *panels_of(const System *system)
{
    const long pairs = system->high / LOCAL;
    return &BY_SIZES[pairs - 1][system->wide / pairs - 1];
}

/* ---- the border */

/* S = Q + delta I of its first entries - Y'Y, whole; 0 where it is not finite */
static int schur_complement(System *system, double delta, long blocks)
{
    const long n = system->columns;
    double *schur = system->schur;
    for (long i = 0; i < n; i++)
        for (long j = 0; j <= i; j++) {
            const double *y = system->solved + i * system->padded, *other = system->solved + j * system->padded;
            const double own = system->corner[i * n + j] + (i == j && i < blocks ? delta : 0.0);
            schur[i * n + j] = schur[j * n + i] = own - ssm_dot(y, other, system->size);
            if (!isfinite(schur[i * n + j]))
                return 0;
        }
    return 1;
}

static int schur_is_a_minimums(System *system, long blocks)
{
    const long n = system->columns;
    long inertia[3], shifted[3];
    memcpy(system->shifted, system->schur, (size_t)(n * n) * sizeof(double));
    for (long i = 0; i < n; i++)
        system->shifted[i * n + i] -= POSITIVE;
    ssm_symmetric_factor(system->shifted, n, system->pivots + n, shifted);
    return ssm_symmetric_factor(system->schur, n, system->pivots, inertia) && shifted[0] == blocks && inertia[0] == blocks;
}

/* Factors of the system, made convex where it is not; 0 where nothing helps. What is not free stays where it is. */
SSM_API int ssm_factorise(System *system, const unsigned char *is_free, long blocks)
{
    const Panels *panels = panels_of(system);
    double delta = 0.0;
    while (delta < MOST) {
        if (panels->factor(system, is_free, delta)) {
            memcpy(system->solved, system->border, (size_t)(system->padded * system->columns) * sizeof(double));
            for (long i = 0; i < system->columns; i++)
                panels->forward(system, system->solved + i * system->padded);
            if (!schur_complement(system, delta, blocks))
                return 0;
            if (schur_is_a_minimums(system, blocks)) {
                system->last = delta > 0.0 ? delta : system->last;
                return 1;
            }
        }
        if (delta == 0.0)
            delta = system->last > 0.0 ? fmax(system->last / DOWN, LEAST) : FIRST;
        else
            delta *= system->last > 0.0 ? UP : UP_FIRST;
    }
    return 0;
}

/* (right, rest) becomes the solution of the system for it */
SSM_API void ssm_solve_factors(const System *system, double *right, double *rest)
{
    const size_t size = (size_t)system->size * sizeof(double);
    double *x = system->right;
    memset(x, 0, (size_t)system->padded * sizeof(double));
    memcpy(x, right, size);
    panels_of(system)->forward(system, x);
    for (long i = 0; i < system->columns; i++)
        rest[i] -= ssm_dot(system->solved + i * system->padded, x, system->size);
    ssm_symmetric_solve(system->schur, system->columns, system->pivots, rest);
    memset(x + system->size, 0, (size_t)(system->padded - system->size) * sizeof(double));
    for (long i = 0; i < system->columns; i++) {
        const double *column = system->solved + i * system->padded;
        for (long k = 0; k < system->size; k++)
            x[k] -= column[k] * rest[i];
    }
    panels_of(system)->backward(system, x);
    memcpy(right, x, size);
}

static void exchange(double *a, long n, long i, long j)
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

/* the largest entry on the diagonal from k on, and the largest below it */
static double largest(const double *a, long n, long k, long *at, long *row, long *column)
{
    double diagonal = -1.0, other = -1.0;
    for (long i = k; i < n; i++) {
        if (fabs(a[i * n + i]) > diagonal) {
            diagonal = fabs(a[i * n + i]);
            *at = i;
        }
        for (long j = k; j < i; j++)
            if (fabs(a[i * n + j]) > other) {
                other = fabs(a[i * n + j]);
                *row = i;
                *column = j;
            }
    }
    return diagonal >= PIVOT * other ? diagonal : -other;
}

static void pivot_of_one(double *a, long n, long k)
{
    const double d = a[k * n + k];
    for (long i = k + 1; i < n; i++) {
        const double share = a[i * n + k] / d;
        for (long j = k + 1; j <= i; j++)
            a[j * n + i] = a[i * n + j] -= share * a[k * n + j];
    }
    for (long i = k + 1; i < n; i++)
        a[i * n + k] /= d;
}

static void pivot_of_two(double *a, long n, long k)
{
    const double d00 = a[k * n + k], d10 = a[(k + 1) * n + k], d11 = a[(k + 1) * n + k + 1];
    const double determinant = d00 * d11 - d10 * d10;
    for (long i = k + 2; i < n; i++) {
        const double x = a[i * n + k], y = a[i * n + k + 1];
        const double first = (d11 * x - d10 * y) / determinant, second = (d00 * y - d10 * x) / determinant;
        for (long j = k + 2; j <= i; j++)
            a[j * n + i] = a[i * n + j] -= first * a[k * n + j] + second * a[(k + 1) * n + j];
        a[i * n + k] = first;
        a[i * n + k + 1] = second;
    }
}

/* a, whole and symmetric, becomes L below D; pivots: what each row was exchanged with, negative less 1 where D has two rows;
 * inertia: how many eigenvalues are positive, negative, zero. 0 where it is singular. */
SSM_API int ssm_symmetric_factor(double *a, long n, long *pivots, long inertia[3])
{
    inertia[0] = inertia[1] = inertia[2] = 0;
    for (long k = 0; k < n;) {
        long at = k, row = k, column = k;
        const double pivot = largest(a, n, k, &at, &row, &column);
        if (pivot == 0.0) {
            inertia[2] = n - k;
            return 0;
        }
        if (pivot > 0.0) {
            exchange(a, n, k, at);
            pivots[k] = at;
            inertia[a[k * n + k] > 0.0 ? 0 : 1]++;
            pivot_of_one(a, n, k);
            k += 1;
        } else {
            exchange(a, n, k, column);
            exchange(a, n, k + 1, row);
            pivots[k] = -column - 1;
            pivots[k + 1] = -row - 1;
            inertia[0]++;
            inertia[1]++;
            pivot_of_two(a, n, k);
            k += 2;
        }
    }
    return 1;
}

static void swap(double *x, long i, long j)
{
    const double kept = x[i];
    x[i] = x[j];
    x[j] = kept;
}

SSM_API void ssm_symmetric_solve(const double *a, long n, const long *pivots, double *x)
{
    for (long k = 0; k < n; k++)
        swap(x, k, pivots[k] < 0 ? -pivots[k] - 1 : pivots[k]);
    for (long k = 0, step; k < n; k += step) {
        step = pivots[k] < 0 ? 2 : 1;
        for (long i = k + step; i < n; i++)
            for (long j = k; j < k + step; j++)
                x[i] -= a[i * n + j] * x[j];
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
            for (long j = first; j <= k; j++)
                x[j] -= a[i * n + j] * x[i];
    }
    for (long k = n - 1; k >= 0; k--)
        swap(x, k, pivots[k] < 0 ? -pivots[k] - 1 : pivots[k]);
}
