/* Scalar operations of a function, in order, each over all samples: those whose result IEEE 754 prescribes, so that NumPy,
 * which does the others, gives the same bits. The program and its slots are made by ssm_planner/codegen/vectorised.py. */

#include <math.h>

#include "native.h"

/* as in vectorised.NATIVE */
enum {
    ASSIGN, NEG, SQRT, SQ, TWICE, INV, FABS, SIGN, NOT, ADD, SUB, MUL, DIV,
    LT, LE, EQ, NE, AND, OR, IF_ELSE_ZERO, FMIN, FMAX
};

/* a result may lie where its operand does, and nowhere between: the loops carry nothing from sample to sample */
#define EACH(x, y, result)                             \
    _Pragma("GCC ivdep") for (long i = 0; i < n; i++)  \
    {                                                  \
        const double a = x, b = y;                     \
        (void)b;                                       \
        out[i] = result;                               \
    }
#define OVER(code, result)                             \
    case code:                                         \
        if (one == 1 && other == 1)                    \
            EACH(first[i], second[i], result)          \
        else if (one == 1 && other == 0)               \
            EACH(first[i], *second, result)            \
        else if (one == 0 && other == 1)               \
            EACH(*first, second[i], result)            \
        else                                           \
            EACH(first[i * one], second[i * other], result) \
        break;

/* steps (count x 4): operation, and slots of its operands and its result; at, stride: where the values of each slot begin, and
 * how far they are apart (0: one value for all n samples; results are beside each other) */
SSM_API void ssm_operations(const long *steps, double *const *at, const long *stride, long count, long n)
{
    for (long k = 0; k < count; k++, steps += 4) {
        const double *first = at[steps[1]], *second = at[steps[2]];
        const long one = stride[steps[1]], other = stride[steps[2]];
        double *out = at[steps[3]];
        switch (steps[0]) {
            OVER(ASSIGN, a)
            OVER(NEG, -a)
            OVER(SQRT, sqrt(a))
            OVER(SQ, a *a)
            OVER(TWICE, a + a)
            OVER(INV, 1.0 / a)
            OVER(FABS, fabs(a))
            OVER(SIGN, a > 0.0 ? 1.0 : a < 0.0 ? -1.0 : a == 0.0 ? 0.0 : a)
            OVER(NOT, a == 0.0)
            OVER(ADD, a + b)
            OVER(SUB, a - b)
            OVER(MUL, a *b)
            OVER(DIV, a / b)
            OVER(LT, a < b)
            OVER(LE, a <= b)
            OVER(EQ, a == b)
            OVER(NE, a != b)
            OVER(AND, a != 0.0 && b != 0.0)
            OVER(OR, a != 0.0 || b != 0.0)
            OVER(IF_ELSE_ZERO, a != 0.0 ? b : 0.0)
            OVER(FMIN, a < b || b != b ? a : b)
            OVER(FMAX, a > b || b != b ? a : b)
        }
    }
}
