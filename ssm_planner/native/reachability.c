/* The passes of planning/retiming/reachability.py, interval after interval. */

#include <math.h>

#include "native.h"

/* A row whose |q| is below this share of its |p| bounds x alone. */
#define LEVEL 1e-10
/* Largest number of iterations of Newton's method for the bounds of an interval. */
#define NEWTON 150
/* Relative distance below 0 at which two lines of an interval count as meeting. */
#define SETTLED 1e-12
/* Share of a value that counts as rounding, as in planning/tolerances.py. */
#define ROUNDING 1e-9

/* of one interval: the lines of (1), `lines` of them, and bounds of x that hold for themselves */
typedef struct {
    double *upper, *upper_slope, *lower, *lower_slope;
    double least, most;
} Interval;

static void lines_of(Interval *at, long m, double width, const double *a, const double *b, const double *c, double ceiling)
{
    double per_step = 1 / (2 * width);
    at->least = 0.0;
    at->most = ceiling;
    for (long k = 0; k < 2 * m; ++k) {
        double share = a[k] * per_step;
        double p = k < m ? b[k] - share : -share, q = k < m ? share : share + b[k], r = 1 - c[k];
        int level = fabs(q) <= LEVEL * fabs(p);
        at->upper[k] = INFINITY;
        at->lower[k] = -INFINITY;
        at->upper_slope[k] = at->lower_slope[k] = 0.0;
        if (level) {
            if (p > 0 && r / p < at->most)
                at->most = r / p;
            if (p < 0 && r / p > at->least)
                at->least = r / p;
            if (p == 0 && r < 0)
                at->least = INFINITY;
        } else if (q > 0) {
            at->upper[k] = r / q;
            at->upper_slope[k] = -p / q;
        } else if (q < 0) {
            at->lower[k] = r / q;
            at->lower_slope[k] = -p / q;
        }
    }
}

/* the nearest x on one side where the lines have room between them, by Newton's method; 0 where there is none */
static int own_bound(const Interval *at, long lines, int sign, double *x)
{
    for (int step = 0; step < NEWTON; ++step) {
        long first = 0, last = 0;
        double upper = at->upper[0] + at->upper_slope[0] * *x, lower = at->lower[0] + at->lower_slope[0] * *x;
        for (long k = 1; k < lines; ++k) {
            double above = at->upper[k] + at->upper_slope[k] * *x, below = at->lower[k] + at->lower_slope[k] * *x;
            if (above < upper) {
                first = k;
                upper = above;
            }
            if (below > lower) {
                last = k;
                lower = below;
            }
        }
        double slope = at->upper_slope[first] - at->lower_slope[last];
        if (!(upper - lower < -SETTLED * (fabs(upper) + fabs(lower))))
            break;
        if (sign * slope <= 0)
            return 0;
        *x -= (upper - lower) / slope;
    }
    return 1;
}

/* ṡ² at the grid points, x[n + 1]; rows a, b, c [n + 1][m]; work: 8 m + 2 (n + 1) + 4 m n numbers. 1: found, 0: none */
SSM_API int ssm_fastest(long n, long m, const double *grid, const double *a, const double *b,
                        const double *c, const double *ceiling, double start, double end, double *x, double *work);

int ssm_fastest(long n, long m, const double *grid, const double *a, const double *b,
                const double *c, const double *ceiling, double start, double end, double *x, double *work)
{
    long lines = 2 * m;
    double *low = work, *high = low + n + 1, *kept = high + n + 1;
    Interval at = {0, 0, kept + 2 * lines * n, kept + 2 * lines * n + lines, 0.0, 0.0};
    if (!isfinite(ceiling[n]) || !(0.0 <= end && end <= (1 + ROUNDING) * ceiling[n]))
        return 0;
    low[n] = high[n] = end;
    for (long i = n - 1; i >= 0; --i) {
        at.upper = kept + 2 * lines * i;
        at.upper_slope = at.upper + lines;
        lines_of(&at, m, grid[i + 1] - grid[i], a + m * i, b + m * i, c + m * i, ceiling[i]);
        double above = at.most, below = at.least;
        if (!isfinite(above) || !isfinite(below) || !own_bound(&at, lines, -1, &above)
            || !own_bound(&at, lines, 1, &below))
            return 0;
        double most = INFINITY, least = -INFINITY;
        for (long k = 0; k < lines; ++k) {
            double slope = at.upper_slope[k];
            if (slope != 0) {
                double met = -at.upper[k] / slope + 1 / slope * low[i + 1];
                if (slope < 0)
                    above = met < above ? met : above;
                else
                    least = met > least ? met : least;
            }
            slope = at.lower_slope[k];
            if (slope != 0) {
                double met = -at.lower[k] / slope + 1 / slope * high[i + 1];
                if (slope > 0)
                    most = met < most ? met : most;
                else
                    below = met > below ? met : below;
            }
        }
        high[i] = most > above ? above : most;
        low[i] = least < below ? below : least;
        if (low[i] > high[i] + ROUNDING * fabs(high[i]))
            return 0;
    }
    if (!((1 - ROUNDING) * low[0] <= start && start <= (1 + ROUNDING) * high[0]))
        return 0;
    double last = start;
    x[0] = start > low[0] ? start : low[0];
    for (long i = 0; i < n; ++i) {
        const double *upper = kept + 2 * lines * i, *slope = upper + lines;
        double next = INFINITY;
        for (long k = 0; k < lines; ++k) {
            double value = upper[k] + slope[k] * last;
            next = value < next ? value : next;
        }
        last = next > high[i + 1] ? high[i + 1] : next;
        x[i + 1] = last > low[i + 1] ? last : low[i + 1];
    }
    return 1;
}
