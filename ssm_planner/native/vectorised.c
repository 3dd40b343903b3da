/* Evaluation of a function for many samples, one scalar operation after the other.
 *
 * Only operations whose results IEEE 754 prescribes are done here, so that NumPy, which does the
 * others, gives the same bits. ssm_planner/codegen/vectorised.py writes the list of operations. */

#include <math.h>

#include "native.h"

/* Operations, in the order of vectorised.NATIVE. */
enum {
    ASSIGN, NEG, SQRT, SQ, TWICE, INV, FABS, SIGN, NOT, ADD, SUB, MUL, DIV,
    LT, LE, EQ, NE, AND, OR, IF_ELSE_ZERO, FMIN, FMAX
};

/* Compute a result for all samples. It may replace an operand, but it must not overlap one
 * otherwise. No sample then depends on another one, and the pragma tells this to the compiler. */
#define FOR_EACH_SAMPLE(x, y, result)                                                              \
    _Pragma("GCC ivdep") for (long i = 0; i < n; i++)                                              \
    {                                                                                              \
        const double a = x, b = y;                                                                 \
        (void)b;                                                                                   \
        out[i] = result;                                                                           \
    }
#define OPERATION(code, result)                                                                    \
    case code:                                                                                     \
        if (first_stride == 1 && second_stride == 1)                                               \
            FOR_EACH_SAMPLE(first[i], second[i], result)                                           \
        else if (first_stride == 1 && second_stride == 0)                                          \
            FOR_EACH_SAMPLE(first[i], *second, result)                                             \
        else if (first_stride == 0 && second_stride == 1)                                          \
            FOR_EACH_SAMPLE(*first, second[i], result)                                             \
        else                                                                                       \
            FOR_EACH_SAMPLE(first[i * first_stride], second[i * second_stride], result)            \
        break;

/* Do `count` operations for n samples. A slot is a variable of the function.
 *
 * steps: operation, slots of both operands and slot of the result (count x 4). slots: first value
 * of each slot. stride: distance between the values of a slot, or 0 if one value applies to all
 * samples. Results are written with a distance of 1. */
SSM_API void ssm_operations(const long *steps, double *const *slots, const long *stride, long count,
                            long n)
{
    for (long k = 0; k < count; k++, steps += 4) {
        const double *first = slots[steps[1]], *second = slots[steps[2]];
        const long first_stride = stride[steps[1]], second_stride = stride[steps[2]];
        double *out = slots[steps[3]];
        switch (steps[0]) {
            OPERATION(ASSIGN, a)
            OPERATION(NEG, -a)
            OPERATION(SQRT, sqrt(a))
            OPERATION(SQ, a * a)
            OPERATION(TWICE, a + a)
            OPERATION(INV, 1.0 / a)
            OPERATION(FABS, fabs(a))
            OPERATION(SIGN, a > 0.0 ? 1.0 : a < 0.0 ? -1.0 : a == 0.0 ? 0.0 : a)
            OPERATION(NOT, a == 0.0)
            OPERATION(ADD, a + b)
            OPERATION(SUB, a - b)
            OPERATION(MUL, a * b)
            OPERATION(DIV, a / b)
            OPERATION(LT, a < b)
            OPERATION(LE, a <= b)
            OPERATION(EQ, a == b)
            OPERATION(NE, a != b)
            OPERATION(AND, a != 0.0 && b != 0.0)
            OPERATION(OR, a != 0.0 || b != 0.0)
            OPERATION(IF_ELSE_ZERO, a != 0.0 ? b : 0.0)
            OPERATION(FMIN, a < b || b != b ? a : b)
            OPERATION(FMAX, a > b || b != b ? a : b)
        }
    }
}
