/* Rows and costs of the elements of a mesh, as the interior point asks for them. */

#ifndef SSM_ELEMENTS_H
#define SSM_ELEMENTS_H

typedef struct {
    double *jacobian, *gradient, *hessian; /* count x rows x size_z; of L, count x size_z; count x size_z x size_z */
} Derivatives;

typedef struct {
    void *context;
    long size_z, rows, costs, count; /* 4 m + 1; rows of G of one element; 1 where there is a cost L; elements of the group */
    /* z: count x size_z, row-major; outputs dense, row-major, one element after the other; 0 is success */
    int (*values_of)(void *context, const double *z, double *g, double *l); /* count x rows; count */
    /* lam: count x (rows + costs), where there is a cost the last of them kappa; sigma: count x rows. The Hessian is that of
     * lam' G + kappa L and J' diag(sigma) J, whole */
    int (*derivatives_of)(void *context, const double *z, const double *lam, const double *sigma, const Derivatives *found);
} ElementGroup;

#endif
