/* Rows and costs of the elements of a mesh, as the interior point asks for them. */

#ifndef SSM_ELEMENTS_H
#define SSM_ELEMENTS_H

typedef struct {
    void *context;
    long size_z, rows, count; /* 4 m + 1; rows of G of one element; elements of the group */
    /* z: count x size_z, row-major; outputs dense, row-major, one element after the other; 0 is success */
    int (*rows_of)(void *context, const double *z, double *g);                      /* count x rows */
    int (*jacobian_of)(void *context, const double *z, double *j);                  /* count x rows x size_z */
    /* lam: count x rows, where there is a cost count x (rows + 1), the last of them kappa */
    int (*hessian_of)(void *context, const double *z, const double *lam, double *h); /* count x size_z x size_z, of lam G + kappa L */
    int (*cost_of)(void *context, const double *z, double *l);                      /* count, or NULL */
    int (*gradient_of)(void *context, const double *z, double *g);                  /* count x size_z, or NULL */
} ElementGroup;

#endif
