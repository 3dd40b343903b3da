/* The structured interior point: what its files share. The values are those of ssm_planner/interior/problem.py. */

#ifndef SSM_INTERIOR_H
#define SSM_INTERIOR_H

#include "elements.h"
#include "native.h"

enum { LOCAL = 4, GIVEN = 5, WIDEST = 5, TERMS = 9, COORDINATES = 4 };
enum { HERMITE = 0, BSPLINE = 1 };

/* ---- memory: blocks that are freed together */

typedef struct MemoryBlock MemoryBlock;
typedef struct {
    MemoryBlock *last;
    int failed;
} Memory;

double *ssm_doubles(Memory *memory, long count); /* zero; where there is none, `failed` is set and NULL returned */
long *ssm_longs(Memory *memory, long count);
void ssm_release(Memory *memory);

/* ---- sums in an order that a processor's width does not change */

static inline double ssm_dot(const double *x, const double *y, long count)
{
    double lane[4] = {0.0};
    long i = 0;
    for (; i + 4 <= count; i += 4)
        for (long k = 0; k < 4; k++)
            lane[k] += x[i + k] * y[i + k];
    for (long k = 0; i < count; i++, k++)
        lane[k] += x[i] * y[i];
    return (lane[0] + lane[1]) + (lane[2] + lane[3]);
}

/* ---- spline.c: M c = sum over terms f(eta) (row . c) */

typedef struct {
    int given;         /* row of M */
    double row[LOCAL]; /* of the unknowns */
} Term;

int ssm_terms(int kind, const Term **terms);
void ssm_term_values(int kind, const double *eta, double value[TERMS]);
void ssm_term_slopes(int kind, const double *eta, double slope[TERMS][WIDEST]);
void ssm_term_curvature(int kind, const double *eta, const double weight[TERMS], double sum[WIDEST][WIDEST]);
void ssm_matrix(int kind, const double *eta, double matrix[GIVEN][LOCAL]);

/* ---- band.c */

typedef struct {
    long size, wide, high, columns, padded; /* of K; of a panel: stride m, LOCAL m; of the border; size + high - wide */
    double *band, *border;  /* K: columns in panels of `wide`, from the first row of the panel; P, column by column, padded */
    double *corner;         /* Q, columns x columns */
    double *factor, *solved; /* L of K + delta I = L L'; L^-1 P */
    double *schur, *shifted; /* S and S - POSITIVE I, factorised */
    double *right;           /* a right-hand side, padded */
    long *pivots;            /* of S, twice */
    double last;             /* delta that was needed last */
} System;

int ssm_system_new(System *system, Memory *memory, long size, long columns, long pairs, long stride);
int ssm_factorise(System *system, const unsigned char *is_free, long blocks);
void ssm_solve_factors(const System *system, double *right, double *rest);
int ssm_symmetric_factor(double *a, long n, long *pivots, long inertia[3]);
void ssm_symmetric_solve(const double *a, long n, const long *pivots, double *x);

/* ---- program.c and derivatives.c */

typedef struct {
    ElementGroup functions;
    const long *elements; /* count */
    const double *bound;  /* count x rows */
    double cost_weight;
} RowGroup;

typedef struct {
    long kind, coordinates, elements, blocks, linear_rows; /* m, n, b, l */
    const double *fractions;                               /* n */
    const long *block;                                     /* n */
    double stretched_from;                                 /* S_0; 0: nodes hold the velocity itself */
    const double *matrix, *bound;                          /* A, l x (5 m + 1); n x l */
    const unsigned char *is_free;                          /* rows x m */
    long equal_count;
    const long *equal_at, *equal_entry;
    const double *equal_value;
    const double *least_times, *smoothing; /* b; m */
    double low, high, time_weight, even;
    long group_count;
    const RowGroup *groups;
} Program;

typedef struct { /* a point and the values there */
    double *c, *times, *z, *rows, *equal;
    double objective;
} Place;

typedef struct { /* rows that count, of one group or the linear ones, element by element */
    long count;       /* elements */
    long *first;      /* count + 1: of the rows that count */
    long *member_at;  /* n + 1: where the members at an element begin in `member` */
    long *member;
    double *z, *values, *jacobian, *hessian, *multipliers, *stiffness, *cost; /* of the functions */
} Part;

typedef struct { /* the different times on which the lengths of an element depend */
    long count, time[WIDEST]; /* of a block, or b: their sum */
    long first;               /* of all elements' */
    long of[WIDEST];          /* of every length: of which it is a share, or -1 */
    double share[WIDEST];
} Lengths;

typedef struct {
    const Program *program;
    Memory memory;
    int kind, failed; /* failed: a function gave no value */
    long m, n, b, w, stride, nodes, size, states, own, terms;
    const Term *term;
    long active, all_rows; /* rows that count, and all */
    long *place_of;   /* of the rows that count among all */
    long *column;     /* row of the element's */
    double *scale;    /* of linear rows: 1 / scale */
    Part *parts;      /* groups, then linear rows */
    long first_time;  /* among the rows that count */
    double totals[2]; /* of the rows of the sum of times */
    long total_count, equal_size;
    long *a_first, *a_column;
    double *a_value;
    /* of the derivatives at one point */
    const Place *at;
    double stretch;
    Lengths *lengths;              /* n */
    double *maps;                  /* n x 5 x 4 */
    double *map_slopes, *by_time;  /* of every time of an element: dM / dtau, 5 x 4; dz / dtau, 5 m + 1 */
    double *cost_by_z, *dual_by_z, *by_z;
    double *all, *with_all; /* of the sum of all times: its border column, and its row of the corner */
} Evaluator;

int ssm_evaluator_new(Evaluator *evaluator, const Program *program);
void ssm_values(Evaluator *evaluator, Place *place);
void ssm_differentiate(Evaluator *evaluator, const Place *place, const double *lam, const double *sigma);
void ssm_dual(Evaluator *evaluator, const double *lam, const double *nu, double *dual);
void ssm_right_side(Evaluator *evaluator, const double *weights, double *right);
void ssm_newton_matrix(Evaluator *evaluator, System *system, const double *sigma);
double ssm_along(Evaluator *evaluator, const double *dc, const double *dt, double *change);

/* ---- solver.c */

typedef struct { /* where a solve begins, and where it ended */
    double *c, *times;               /* rows x m; b */
    double *slacks, *multipliers;    /* of all rows: 1 and 0 of those that do not count */
    double *equality_multipliers, *z; /* q; n x (5 m + 1) */
    double objective;
    long iterations;
} State;

enum { NOT_CONVERGED = 0, CONVERGED = 1, NO_VALUE = 2, NO_MEMORY = 3 };
/* how long, to what residual, mu's exponent from one barrier problem to the next, the first mu of a cold start, and by which
 * share s lam may be off the last mu, if a few iterations more can do it */
typedef struct {
    long iterations;
    double tolerance, superlinear, barrier, off_centre;
} Patience;

int ssm_solve(const Program *program, State *state, int warm, const Patience *patience);

#endif
