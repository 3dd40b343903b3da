/* Fastest motion on a grid, by the backward and the forward pass of TOPP-RA.
 *
 * planning/retiming/reachability.py states equations (1) and (2), to which the comments refer.
 * Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
 * Reachability Analysis, IEEE T-RO 34(3), 2018, section III.
 */

#include <math.h>

#include "native.h"

/* A constraint p x + q w <= r with |q| <= LEVEL |p| bounds only x. */
#define LEVEL 1e-10
/* Largest number of iterations of Newton's method for the bounds of an interval. */
#define NEWTON 150
/* Lines U and L are taken to meet if U - L >= -SETTLED (|U| + |L|). */
#define SETTLED 1e-12
/* Share of a value that counts as rounding, as in planning/tolerances.py. */
#define ROUNDING 1e-9

/* Constraints of one interval of the grid. x and w are the squared path speeds ṡ² at its start and
 * its end, 1/s². Each of the 2 m constraints gives a line w <= upper + upper_slope x or w >= lower
 * + lower_slope x, and infinity replaces the other one. */
typedef struct {
    double *upper, *upper_slope; /* intercepts and slopes of the lines above w (2 m each) */
    double *lower, *lower_slope; /* intercepts and slopes of the lines below w (2 m each) */
    double least, most;          /* bounds of x from constraints without w, and from the ceiling */
} Interval;

/* Compute the lines of an interval from the constraints a s̈ + b ṡ² + c <= 1 at both of its ends.
 * With s̈ = (w - x) / (2 width), each becomes p x + q w <= r.
 *
 * m: number of constraints at a grid point. width: length of the interval. a, b, c: coefficients
 * at the start (m), followed by those at the end (m). ceiling: largest ṡ² at the start, 1/s².
 */
static void compute_lines(Interval *interval, long m, double width, const double *a,
                          const double *b, const double *c, double ceiling)
{
    double per_step = 1 / (2 * width);
    interval->least = 0.0;
    interval->most = ceiling;
    for (long k = 0; k < 2 * m; ++k) {
        double scaled = a[k] * per_step;
        double p = k < m ? b[k] - scaled : -scaled, q = k < m ? scaled : scaled + b[k],
               r = 1 - c[k];
        int bounds_x_alone = fabs(q) <= LEVEL * fabs(p);
        interval->upper[k] = INFINITY;
        interval->lower[k] = -INFINITY;
        interval->upper_slope[k] = interval->lower_slope[k] = 0.0;
        if (bounds_x_alone) {
            if (p > 0 && r / p < interval->most) interval->most = r / p;
            if (p < 0 && r / p > interval->least) interval->least = r / p;
            if (p == 0 && r < 0) interval->least = INFINITY;
        } else if (q > 0) {
            interval->upper[k] = r / q;
            interval->upper_slope[k] = -p / q;
        } else if (q < 0) {
            interval->lower[k] = r / q;
            interval->lower_slope[k] = -p / q;
        }
    }
}

/* Move x to the end of the range in which L(x) <= U(x), see (1), by Newton's method for U - L = 0.
 * U - L is concave, so the iterations approach the end from outside and do not pass it.
 *
 * sign: -1 finds the upper end from a larger x, 1 finds the lower end from a smaller x. x remains
 * unchanged if it is already in the range. Return 0 if U - L does not increase in the direction of
 * the search, so that no such x exists. Otherwise return 1.
 */
static int find_bound(const Interval *interval, long lines, int sign, double *x)
{
    for (int step = 0; step < NEWTON; ++step) {
        long first = 0, last = 0;
        double upper = interval->upper[0] + interval->upper_slope[0] * *x,
               lower = interval->lower[0] + interval->lower_slope[0] * *x;
        for (long k = 1; k < lines; ++k) {
            double upper_value = interval->upper[k] + interval->upper_slope[k] * *x,
                   lower_value = interval->lower[k] + interval->lower_slope[k] * *x;
            if (upper_value < upper) {
                first = k;
                upper = upper_value;
            }
            if (lower_value > lower) {
                last = k;
                lower = lower_value;
            }
        }
        double slope = interval->upper_slope[first] - interval->lower_slope[last];
        if (!(upper - lower < -SETTLED * (fabs(upper) + fabs(lower)))) break;
        if (sign * slope <= 0) return 0;
        *x -= (upper - lower) / slope;
    }
    return 1;
}

/* Compute the fastest motion on a grid of n intervals with m constraints a s̈ + b ṡ² + c <= 1 per
 * point.
 *
 * grid: path parameter s (n + 1). a, b, c: coefficients (n + 1 x m). ceiling: largest ṡ² at each
 * point (n + 1), 1/s². start, end: ṡ² at both ends of the path. x: result ṡ² (n + 1). work:
 * workspace of 8 m + 2 (n + 1) + 4 m n numbers. Return 1 if there is a motion. Otherwise return 0.
 */
SSM_API int ssm_fastest(long n, long m, const double *grid, const double *a, const double *b,
                const double *c, const double *ceiling, double start, double end, double *x,
                double *work)
{
    long lines = 2 * m;
    double *low = work, *high = low + n + 1, *upper_lines = high + n + 1;
    Interval interval = {0,   0,  upper_lines + 2 * lines * n, upper_lines + 2 * lines * n + lines,
                         0.0, 0.0};
    if (!isfinite(ceiling[n]) || !(0.0 <= end && end <= (1 + ROUNDING) * ceiling[n])) return 0;
    low[n] = high[n] = end;
    /* Backward pass: [low, high] is the range of ṡ² from which a motion can reach the end, see
     * (2). */
    for (long i = n - 1; i >= 0; --i) {
        interval.upper = upper_lines + 2 * lines * i;
        interval.upper_slope = interval.upper + lines;
        compute_lines(&interval, m, grid[i + 1] - grid[i], a + m * i, b + m * i, c + m * i,
                      ceiling[i]);
        double highest = interval.most, lowest = interval.least;
        if (!isfinite(highest) || !isfinite(lowest) ||
            !find_bound(&interval, lines, -1, &highest) ||
            !find_bound(&interval, lines, 1, &lowest))
            return 0;
        double most = INFINITY, least = -INFINITY;
        for (long k = 0; k < lines; ++k) {
            double slope = interval.upper_slope[k];
            if (slope != 0) {
                double crossing = -interval.upper[k] / slope + 1 / slope * low[i + 1];
                if (slope < 0)
                    highest = crossing < highest ? crossing : highest;
                else
                    least = crossing > least ? crossing : least;
            }
            slope = interval.lower_slope[k];
            if (slope != 0) {
                double crossing = -interval.lower[k] / slope + 1 / slope * high[i + 1];
                if (slope > 0)
                    most = crossing < most ? crossing : most;
                else
                    lowest = crossing > lowest ? crossing : lowest;
            }
        }
        high[i] = most > highest ? highest : most;
        low[i] = least < lowest ? lowest : least;
        if (low[i] > high[i] + ROUNDING * fabs(high[i])) return 0;
    }
    if (!((1 - ROUNDING) * low[0] <= start && start <= (1 + ROUNDING) * high[0])) return 0;
    double fastest = start;
    x[0] = start > low[0] ? start : low[0];
    /* Forward pass: take the largest ṡ² in this range that the lines U allow. */
    for (long i = 0; i < n; ++i) {
        const double *upper = upper_lines + 2 * lines * i, *slope = upper + lines;
        double next = INFINITY;
        for (long k = 0; k < lines; ++k) {
            double value = upper[k] + slope[k] * fastest;
            next = value < next ? value : next;
        }
        fastest = next > high[i + 1] ? high[i + 1] : next;
        x[i + 1] = fastest > low[i + 1] ? fastest : low[i + 1];
    }
    return 1;
}
