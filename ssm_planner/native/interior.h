/* Types and functions that the files of the structured interior-point solver share.
 *
 * ssm_planner/interior/problem.py states the optimisation problem, and spline.py describes the
 * splines. Their notation applies here: n elements, m coordinates and b blocks of elements with a
 * common duration T. The vector z (5 m + 1) describes an element. Its entries are u (m), u' (m),
 * u'' at the start (m), u'' at the end (m), the duration h, and the middle Bernstein coefficient
 * u'_b of the velocity (m). Times are in the scaled unit in which the problem is stated.
 */

#ifndef SSM_INTERIOR_H
#define SSM_INTERIOR_H

#include "elements.h"
#include "native.h"

/* LOCAL: rows of unknowns on which one element depends. GIVEN: vectors of m numbers in z, which
 * are the rows of the matrix M. WIDEST: largest number of lengths eta of an element. TERMS:
 * largest number of terms of M. COORDINATES: largest number m of coordinates. */
enum { LOCAL = 4, GIVEN = 5, WIDEST = 5, TERMS = 9, COORDINATES = 4 };
/* Kinds of splines. HERMITE has continuous u and u', BSPLINE has continuous u'' as well. */
enum { HERMITE = 0, BSPLINE = 1 };

/* ---- Memory: a list of blocks that ssm_release frees together */

typedef struct MemoryBlock MemoryBlock;
typedef struct {
    MemoryBlock *last; /* the newest block, which points to the one before it */
    int failed;        /* 1 after an allocation that failed */
} Memory;

/* Allocate `count` zeros. Set `failed` and return NULL if there is not enough memory. */
double *ssm_doubles(Memory *memory, long count);
long *ssm_longs(Memory *memory, long count);
/* Free all blocks. */
void ssm_release(Memory *memory);

/* ---- Sums */

/* Return the scalar product of x and y (count each). The order of the additions is fixed, so that
 * processors with vector registers of different widths give the same bits. */
static inline double ssm_dot(const double *x, const double *y, long count)
{
    double lane[4] = {0.0};
    long i = 0;
    for (; i + 4 <= count; i += 4)
        for (long k = 0; k < 4; k++) lane[k] += x[i + k] * y[i + k];
    for (long k = 0; i < count; i++, k++) lane[k] += x[i] * y[i];
    return (lane[0] + lane[1]) + (lane[2] + lane[3]);
}

/* ---- spline.c: maps from the unknowns of an element to its z
 *
 * The matrix M (GIVEN x LOCAL) depends on the lengths eta. It is a sum of terms f(eta), each of
 * which multiplies a constant row.
 */

typedef struct {
    int given;         /* row of M to which the term belongs */
    double row[LOCAL]; /* coefficients of the four rows of unknowns */
} Term;

int ssm_terms(int kind, const Term **terms);
void ssm_term_values(int kind, const double *eta, double value[TERMS]);
void ssm_term_slopes(int kind, const double *eta, double slope[TERMS][WIDEST]);
void ssm_term_curvature(int kind, const double *eta, const double weight[TERMS],
                        double sum[WIDEST][WIDEST]);
void ssm_matrix(int kind, const double *eta, double matrix[GIVEN][LOCAL]);

/* ---- band.c: the linear system of a Newton step, see the equation there */

typedef struct {
    long size,    /* number of rows of K */
        width,    /* columns of a panel: stride m */
        height,   /* numbers that are stored of each column of a panel: LOCAL m */
        columns,  /* columns of the border P: the blocks and the equality constraints */
        padded;   /* size + height - width: length of a vector with zeros after its end */
    double *band, /* K (size x height). Each column begins at the first row of its panel */
        *border,  /* P, column by column (columns x padded) */
        *corner,  /* Q (columns x columns) */
        *factor,  /* L with K + delta I = L L', stored like K with reciprocals on the diagonal */
        *solved,  /* Y = L^-1 P, stored like P */
        *schur,   /* Schur complement S (columns x columns), then its factors */
        *shifted, /* S - LEAST_EIGENVALUE I, then its factors */
        *right;   /* right-hand side and solution of a system with K (padded) */
    long *pivots; /* exchanges of rows of S (columns), then of the shifted S (columns) */
    double last_delta; /* the last delta > 0 that made the system convex, or 0 */
} System;

int ssm_system_new(System *system, Memory *memory, long size, long columns, long pairs,
                   long stride);
int ssm_factorise(System *system, const unsigned char *is_free, long blocks);
void ssm_solve_factors(const System *system, double *right, double *rest);
int ssm_symmetric_factor(double *a, long n, long *pivots, long inertia[3]);
void ssm_symmetric_solve(const double *a, long n, const long *pivots, double *x);

/* ---- program.c and derivatives.c: the optimisation problem, its values and its derivatives */

/* Constraints G(z) <= bound and the cost L of some elements. */
typedef struct {
    ElementGroup functions;
    const long *elements; /* index of the element of each member (count) */
    const double *bound;  /* upper bounds (count x rows). INFINITY means no bound */
    double cost_weight;   /* weight w_c of L */
} RowGroup;

/* The optimisation problem. interior/solve.py fills the struct, so the order of the fields is
 * fixed. */
typedef struct {
    long kind,               /* HERMITE or BSPLINE */
        coordinates,         /* m */
        elements,            /* n */
        blocks,              /* b */
        linear_rows;         /* l */
    const double *fractions; /* length of each element as a share of its block's duration (n) */
    const long *block;       /* index of the block of each element (n) */
    double stretched_from;   /* S_0, or 0 if the unknowns of a Hermite spline contain u' itself */
    const double *matrix,    /* A (l x (5 m + 1)) */
        *bound;              /* upper bounds of A z (n x l). INFINITY means no bound */
    const unsigned char *is_free; /* 1 for unknowns that may change, 0 for fixed ones (rows x m) */
    long equal_count;             /* number q of equality constraints z_k[i] = value */
    const long *equal_at,         /* element k of each equality (q) */
        *equal_entry;             /* index i of each equality (q) */
    const double *equal_value,    /* value of each equality (q) */
        *least_times,             /* smallest durations of the blocks (b) */
        *smoothing;               /* weights p of squared accelerations (m) */
    double low, high,             /* bounds of the total duration. Equal bounds fix it */
        time_weight,              /* weight w_t of the total duration */
        even;                     /* weight e of the variance of T / T_least */
    long group_count;
    const RowGroup *groups;
} Program;

/* Values of the unknowns, and of the functions that depend on them. */
typedef struct {
    double *c,        /* unknowns of the spline (size) */
        *times,       /* durations T of the blocks (b) */
        *z,           /* vectors z of all elements (n x (5 m + 1)) */
        *rows,        /* active rows r, which must be <= 0 (active) */
        *equal;       /* residuals of the equality constraints (equal_size) */
    double objective; /* the function f that is minimised */
} Point;

/* Active rows of one group, or of the linear constraints. program.c explains which rows are
 * active. A member is an entry of RowGroup.elements. For linear constraints,
 * the members are the elements, and only the first two fields are set. */
typedef struct {
    long count;        /* number of members */
    long *first,       /* index of the first active row of each member, and the end (count + 1) */
        *member_first, /* where the members of each element begin in `member` (n + 1) */
        *member;       /* members in the order of their elements (count) */
    double *z,         /* arguments of the functions G and L (count x size_z) */
        *values,       /* G (count x rows) */
        *jacobian,     /* dG/dz (count x rows x size_z) */
        *hessian,      /* second derivatives by z (count x size_z x size_z) */
        *multipliers,  /* lambda of every row, then cost_weight (count x (rows + costs)) */
        *stiffness,    /* sigma = lambda / slack of every row (count x rows) */
        *cost;         /* L (count), or its gradient (count x size_z) */
} Part;

/* Dependence of the lengths eta of one element on times tau: the duration of a block, or the sum of
 * all durations. Each length is a constant, or a share of one of these times. */
typedef struct {
    long count,             /* number of different times tau */
        time[WIDEST],       /* index of the block of each tau, or b for the sum of all durations */
        first,              /* number of times of all previous elements together */
        time_index[WIDEST]; /* index in `time` for each length, or -1 for a constant length */
    double share[WIDEST];   /* derivative of each length by its time */
} Lengths;

/* A problem with the memory that its evaluation needs. */
typedef struct {
    const Program *program;
    Memory memory;
    int kind,           /* HERMITE or BSPLINE */
        failed;         /* not 0 if a function of a group could not be evaluated */
    long m, n, b,       /* numbers of coordinates, elements and blocks */
        w,              /* number of lengths eta of an element */
        stride,         /* rows of unknowns from one element to the next */
        nodes,          /* rows of unknowns */
        size,           /* number of unknowns c: nodes m */
        states,         /* length of z: 5 m + 1 */
        duration_index, /* index in eta of the element's own duration h */
        terms;          /* number of terms of M */
    const Term *term;
    long active,      /* number of active rows */
        all_rows;     /* number of rows of the problem */
    long *row_index,  /* index among all rows of each active row (active) */
        *column;      /* index of each active row among those of its member (active) */
    double *scale;    /* factor of each linear row: 1 / bound, or 1 unless bound > 0 (active) */
    Part *parts;      /* one for each group, then one for the linear constraints */
    long first_time;  /* index of the first row of T >= T_least among the active rows */
    double totals[2]; /* coefficients of the total duration in its rows: 1 / high and -1 / low */
    long total_count, /* number of these rows */
        equal_size;   /* number of equalities, including that of a fixed total duration */
    long *a_first,    /* where each row of A begins in the following two arrays (l + 1) */
        *a_column;    /* columns of the entries of A that are not 0 */
    double *a_value;  /* their values */
    /* The following fields contain derivatives at one point. */
    const Point *point;
    double stretch;    /* s = sum T / S_0, or 1 */
    Lengths *lengths;  /* (n) */
    double *maps,      /* matrix M of each element (n x 5 x 4) */
        *map_slopes,   /* dM/dtau of each time of each element (5 x 4 each) */
        *by_time,      /* dz/dtau of each time of each element (5 m + 1 each) */
        *cost_by_z,    /* gradient by z of the part of f that depends on z (n x (5 m + 1)) */
        *dual_by_z,    /* gradient by z of the Lagrangian (n x (5 m + 1)) */
        *by_z,         /* workspace for a vector by z (n x (5 m + 1)) */
        *total_border, /* second derivatives by c and by the total duration (size) */
        *total_corner; /* those by the total duration and each time, then twice by it (b + 1) */
} Evaluator;

int ssm_evaluator_new(Evaluator *evaluator, const Program *program);
void ssm_values(Evaluator *evaluator, Point *point);
void ssm_differentiate(Evaluator *evaluator, const Point *point, const double *lam,
                       const double *sigma);
void ssm_dual(Evaluator *evaluator, const double *lam, const double *nu, double *dual);
void ssm_right_side(Evaluator *evaluator, const double *weights, double *right);
void ssm_newton_matrix(Evaluator *evaluator, System *system, const double *sigma);
double ssm_along(Evaluator *evaluator, const double *dc, const double *dt, double *change);

/* ---- solver.c */

/* Start of a solve, which ssm_solve replaces by its result. */
typedef struct {
    double *c, *times,         /* unknowns of the spline (rows x m), and durations (b) */
        *slacks, *multipliers, /* of all rows. Inactive rows have slack 1 and multiplier 0 */
        *equality_multipliers, /* (equal_size) */
        *z,                    /* vectors of all elements (n x (5 m + 1)) */
        objective;             /* value of f */
    long iterations;           /* number of iterations */
} State;

/* Results of ssm_solve. NO_VALUE means that a function could not be evaluated. */
enum { NOT_CONVERGED = 0, CONVERGED = 1, NO_VALUE = 2, NO_MEMORY = 3 };

/* Options of a solve. */
typedef struct {
    long iterations;  /* largest number of iterations */
    double tolerance, /* largest residual of a converged solution */
        superlinear,  /* exponent that reduces mu from one barrier problem to the next */
        barrier,      /* first mu of a cold start */
        off_centre;   /* largest |s lambda / mu - 1| after which no centring iteration follows */
} Patience;

int ssm_solve(const Program *program, State *state, int warm, const Patience *patience);

#endif
