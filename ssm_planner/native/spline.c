/* Maps from the unknowns of cubic elements to their states, and derivatives of the maps by the
 * lengths eta.
 *
 * ssm_planner/interior/spline.py describes the splines. u, u', u'' at the start, u'' at the end,
 * and u'_b of an element are M c. Each is a sum of terms f(eta) (row . c) with constant rows.
 *
 * Hermite, eta = (h, s):     u = c0,  u' = c1 / s
 *   u''_0 = 6 (c2 - c0) / h^2 - (4 c1 + 2 c3) / (h s)
 *   u''_1 = -6 (c2 - c0) / h^2 + (2 c1 + 4 c3) / (h s)
 *   u'_b  = 3 (c2 - c0) / h - (c1 + c3) / s
 *
 * B-spline, eta = (b2, b, h, a, a2), D_k = c_{k+1} - c_k, spans S_0 = b2 + b + h, S_1 = b + h + a,
 * S_2 = h + a + a2, P_0 = b + h, P_1 = h + a (de Boor, A Practical Guide to Splines, ch. IX):
 *   u     = c1 - h^2 D_0 / (S_0 P_0) + b^2 D_1 / (S_1 P_0)
 *   u'    = 3 h D_0 / (S_0 P_0) + 3 b D_1 / (S_1 P_0)
 *   u''_0 = 6 (D_1 / S_1 - D_0 / S_0) / P_0,   u''_1 = 6 (D_2 / S_2 - D_1 / S_1) / P_1
 *   u'_b  = 3 D_1 / S_1
 *
 * Each term is g(x) / (S P), where g is a power of one length x, and S and P are spans.
 */

#include <string.h>

#include "interior.h"

static const Term HERMITE_TERMS[] = {
    {0, {1, 0, 0, 0}},  {1, {0, 1, 0, 0}}, {2, {-6, 0, 6, 0}}, {2, {0, -4, 0, -2}},
    {3, {6, 0, -6, 0}}, {3, {0, 2, 0, 4}}, {4, {-3, 0, 3, 0}}, {4, {0, -1, 0, -1}},
};

static const Term BSPLINE_TERMS[] = {
    {0, {1, -1, 0, 0}}, {0, {0, -1, 1, 0}}, {1, {-3, 3, 0, 0}},
    {1, {0, -3, 3, 0}}, {2, {6, -6, 0, 0}}, {2, {0, -6, 6, 0}},
    {3, {0, 6, -6, 0}}, {3, {0, 0, -6, 6}}, {4, {0, -3, 3, 0}},
};

/* Factors of each term of a B-spline: index in eta of the length in g, its power, index k of S_k,
 * and index k of P_k (2 means no P_k). */
static const struct {
    int length, power, outer, inner;
} FACTORS[] = {
    {2, 2, 0, 0}, {1, 2, 1, 0}, {2, 1, 0, 0}, {1, 1, 1, 0}, {2, 0, 0, 0},
    {2, 0, 1, 0}, {2, 0, 1, 1}, {2, 0, 2, 1}, {2, 0, 1, 2},
};

/* Store the address of the terms of a kind of spline. Return their number. */
SSM_API int ssm_terms(int kind, const Term **terms)
{
    *terms = kind == HERMITE ? HERMITE_TERMS : BSPLINE_TERMS;
    return kind == HERMITE ? 8 : 9;
}

/* Factors of a term, and derivatives. */
typedef struct {
    double g, g1, g2; /* g(x) = x^power, g'(x), g''(x) */
    double s, p;      /* reciprocals of the spans S and P */
} Product;

/* Compute the reciprocals of S_0, S_1, S_2 (outer), of P_0, P_1, and 1 (inner). */
static void invert_spans(const double *eta, double outer[3], double inner[3])
{
    for (int k = 0; k < 3; k++) outer[k] = 1.0 / (eta[k] + eta[k + 1] + eta[k + 2]);
    inner[0] = 1.0 / (eta[1] + eta[2]);
    inner[1] = 1.0 / (eta[2] + eta[3]);
    inner[2] = 1.0;
}

/* Return the factors of term t. */
static Product factor_term(int t, const double *eta, const double outer[3], const double inner[3])
{
    const double x = eta[FACTORS[t].length];
    const int power = FACTORS[t].power;
    Product f = {1.0, 0.0, 0.0, outer[FACTORS[t].outer], inner[FACTORS[t].inner]};
    if (power == 1) {
        f.g = x;
        f.g1 = 1.0;
    } else if (power == 2) {
        f.g = x * x;
        f.g1 = 2.0 * x;
        f.g2 = 2.0;
    }
    return f;
}

/* Compute f(eta) of all terms. */
SSM_API void ssm_term_values(int kind, const double *eta, double value[TERMS])
{
    if (kind == HERMITE) {
        const double h = 1.0 / eta[0], s = 1.0 / eta[1];
        const double values[] = {1.0, s, h * h, h * s, h * h, h * s, h, s};
        memcpy(value, values, sizeof values);
        return;
    }
    double outer[3], inner[3];
    invert_spans(eta, outer, inner);
    for (int t = 0; t < 9; t++) {
        const Product f = factor_term(t, eta, outer, inner);
        value[t] = f.g * f.s * f.p;
    }
}

/* Compute the derivatives of f by each length for all terms. */
SSM_API void ssm_term_slopes(int kind, const double *eta, double slope[TERMS][WIDEST])
{
    memset(slope, 0, sizeof(double[TERMS][WIDEST]));
    if (kind == HERMITE) {
        const double h = 1.0 / eta[0], s = 1.0 / eta[1];
        slope[1][1] = slope[7][1] = -s * s;
        slope[2][0] = slope[4][0] = -2.0 * h * h * h;
        slope[3][0] = slope[5][0] = -h * h * s;
        slope[3][1] = slope[5][1] = -h * s * s;
        slope[6][0] = -h * h;
        return;
    }
    double outer[3], inner[3];
    invert_spans(eta, outer, inner);
    for (int t = 0; t < 9; t++) {
        const Product f = factor_term(t, eta, outer, inner);
        const double value = f.g * f.s * f.p;
        slope[t][FACTORS[t].length] += f.g1 * f.s * f.p;
        for (int k = FACTORS[t].outer; k < FACTORS[t].outer + 3; k++) slope[t][k] -= value * f.s;
        if (FACTORS[t].inner < 2)
            for (int k = FACTORS[t].inner + 1; k < FACTORS[t].inner + 3; k++)
                slope[t][k] -= value * f.p;
    }
}

/* Add a (v w' + w v') to `sum`. v is 1 at the indices from x to x_end - 1, otherwise 0, and w
 * likewise. */
static void add_pair(double sum[WIDEST][WIDEST], double a, int x, int x_end, int y, int y_end)
{
    for (int i = x; i < x_end; i++)
        for (int j = y; j < y_end; j++) {
            sum[i][j] += a;
            sum[j][i] += a;
        }
}

/* Compute the sum over the terms of weight times the matrix of second derivatives of f by the
 * lengths. */
SSM_API void ssm_term_curvature(int kind, const double *eta, const double weight[TERMS],
                                double sum[WIDEST][WIDEST])
{
    memset(sum, 0, sizeof(double[WIDEST][WIDEST]));
    if (kind == HERMITE) {
        const double h = 1.0 / eta[0], s = 1.0 / eta[1], both = weight[3] + weight[5],
                     squares = weight[2] + weight[4];
        sum[0][0] = 6.0 * squares * h * h * h * h + 2.0 * both * h * h * h * s +
                    2.0 * weight[6] * h * h * h;
        sum[0][1] = sum[1][0] = both * h * h * s * s;
        sum[1][1] = 2.0 * (weight[1] + weight[7]) * s * s * s + 2.0 * both * h * s * s * s;
        return;
    }
    double outer[3], inner[3];
    invert_spans(eta, outer, inner);
    for (int t = 0; t < 9; t++) {
        const Product f = factor_term(t, eta, outer, inner);
        const int x = FACTORS[t].length, s = FACTORS[t].outer, p = FACTORS[t].inner + 1;
        const double rest = weight[t] * f.s * f.p, value = rest * f.g;
        sum[x][x] += rest * f.g2;
        add_pair(sum, value * f.s * f.s, s, s + 3, s, s + 3);
        if (f.g1 != 0.0) add_pair(sum, -rest * f.g1 * f.s, x, x + 1, s, s + 3);
        if (p < 3) {
            add_pair(sum, value * f.p * f.p, p, p + 2, p, p + 2);
            add_pair(sum, value * f.s * f.p, s, s + 3, p, p + 2);
            if (f.g1 != 0.0) add_pair(sum, -rest * f.g1 * f.p, x, x + 1, p, p + 2);
        }
    }
}

/* Compute M (GIVEN x LOCAL). */
SSM_API void ssm_matrix(int kind, const double *eta, double matrix[GIVEN][LOCAL])
{
    const Term *term;
    const int count = ssm_terms(kind, &term);
    double value[TERMS];
    ssm_term_values(kind, eta, value);
    memset(matrix, 0, sizeof(double[GIVEN][LOCAL]));
    if (kind == BSPLINE) matrix[0][1] = 1.0;
    for (int t = 0; t < count; t++)
        for (int j = 0; j < LOCAL; j++) matrix[term[t].given][j] += value[t] * term[t].row[j];
}
