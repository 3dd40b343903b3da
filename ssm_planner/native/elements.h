/* Interface through which the interior-point solver evaluates constraints and costs of elements.
 *
 * A mesh divides a motion into elements. A row is one constraint function of an element's vector
 * z. */

#ifndef SSM_ELEMENTS_H
#define SSM_ELEMENTS_H

/* Outputs of ElementGroup.derivatives_of, dense and row-major. */
typedef struct {
    double *jacobian, /* dG/dz (count x rows x size_z) */
        *gradient,    /* dL/dz (count x size_z), not used without a cost */
        *hessian;     /* second derivatives, see ElementGroup (count x size_z x size_z) */
} Derivatives;

/* Functions G and L of several elements. */
typedef struct {
    void *context; /* first argument of both functions */
    long size_z,   /* number of entries of z on which G and L depend: 4 m + 1 with m coordinates */
        rows,      /* number of rows of G of one element */
        costs,     /* 1 if there is a cost L, otherwise 0 */
        count;     /* number of elements */
    /* Compute G (count x rows) and L (count) from z (count x size_z). Return 0 on success. */
    int (*values_of)(void *context, const double *z, double *g, double *l);
    /* Compute the derivatives at z. The multipliers lam (count x (rows + costs)) contain those of
     * G, and then kappa if there is a cost. The Hessian of an element is that of lam' G + kappa L,
     * plus J' diag(sigma) J with the stiffness sigma (count x rows). Return 0 on success. */
    int (*derivatives_of)(void *context, const double *z, const double *lam, const double *sigma,
                          const Derivatives *found);
} ElementGroup;

#endif
