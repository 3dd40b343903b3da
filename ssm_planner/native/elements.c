/* Rows and costs of the elements of a mesh: the parts of kernels.h put together by the chain rule.

At every point of an element the rows g and the cost are functions of quantities (efforts of the joints, their rates, the
tool's place), these of y, and y of z. y is, of a free motion, q, qd and qdd of all joints, of a straight one its x.
Four elements are taken at once; every number is a vector of theirs. */

#include <math.h>
#include <string.h>

#include "native.h"
#include "elements.h"
#include "lanes.h"

#define Y 12   /* most entries of y */
#define Z 17   /* most entries of z */
#define EACH 5 /* most entries of y of one coordinate, and entries of z */

#define V(name) v_##name
#include "kernels.h"

typedef struct {
    long straight, count, m, rows, points, loads, actuations, costs, effort, hull;
    const double *shares, *weights; /* of the points: where, and in integrals */
    const long *moving;             /* joints of the coordinates of a free motion */
    const long *undriven;           /* 4: joints that may move either way */
    const long *slots;              /* row of a point in which each of all rows stands, or -1 */
    const long *actuation;          /* joint, load, law of each; by load */
    const double *drives;           /* figures of each */
    const long *cost;               /* joint and law of each motor in the cost */
    const double *cost_drives, *cost_weights;
    const double *load, *mechanism, *eye, *limits;
    const double *sigma; /* of each element */
    const double *fits;  /* of LANES elements at once, the last ones repeated: 2 of the place, then each curve's coefficients */
    double offset;
} Elements;

enum { FREE_ACTUATIONS = 13, JOINT_ROWS = 10, STRAIGHT_ACTUATIONS = 1 + 4 * JOINT_ROWS };

typedef void (*At)(const real *drive, const real *sigma, const real *v, real *restrict g);
typedef void (*By)(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by);
typedef void (*Bend)(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend);
typedef struct {
    At at;
    By by;
    Bend bend;
} Law;

#define LAW(name) {name##_at, name##_by, name##_bend}
static const Law TORQUES[] = {
    LAW(worm_coulomb), LAW(worm_stribeck_exponential), LAW(worm_stribeck_gaussian), LAW(antibacklash_screw_coulomb),
    LAW(antibacklash_screw_stribeck_exponential), LAW(antibacklash_screw_stribeck_gaussian),
};
static const Law PULLS[] = {
    LAW(worm_coulomb_pull), LAW(worm_stribeck_exponential_pull), LAW(worm_stribeck_gaussian_pull),
    LAW(antibacklash_screw_coulomb_pull), LAW(antibacklash_screw_stribeck_exponential_pull),
    LAW(antibacklash_screw_stribeck_gaussian_pull),
};

typedef struct { /* constants where functions are inlined, so that the compiler knows the length of every loop */
    int straight;
    long m, ny, each, size; /* coordinates; entries of y, of one coordinate, of z */
} Shape;

typedef struct { /* what is asked for; NULL: not */
    double *rows, *jacobian, *hessian; /* hessian: of lam' rows, kappa times the cost, and J' diag(stiffness) J */
    double *cost, *gradient;
    const double *lam, *stiffness; /* stiffness: NULL for 0 */
} Wanted;

typedef struct {
    const Elements *of;
    Wanted wanted;
    int order, costs; /* of the derivatives that it takes; whether the cost is asked for */
    Shape shape;
    long block, point;
    long element[LANES]; /* of the block, the last one repeated */
    /* figures */
    real prepared[SSM_PREPARED], limits[SSM_FREE_SIZE], first[4];
    /* of the elements */
    real z[Z], sigma[4];
    /* of the point: y by z of each coordinate, and which entries those are */
    real y[Y], by_z[4][EACH * EACH];
    long entry[4][EACH];
    real tau[4], tau_by[4 * Y], still[4], still_by[4 * Y];
    real rate[4][4], rate_by[4][4][Y]; /* qd, qd in the velocity rows, qdd, qddd */
    real speed, speed_by[Y];
    /* what comes of it: of the Lagrangian and the cost at the point, then of the element */
    real phi_by[Y], bend[Y * Y], cost, cost_by[Y];
    real tau_weight[4], still_weight[4], rate_weight[4][4], speed_weight;
    real hessian[Z * Z], gradient[Z], integral;
} Work;

/* ---- between elements and lanes */

static real gather(const double *values, long stride, long entry, const Work *w)
{
    real found;
    for (long k = 0; k < LANES; k++) found[k] = values[w->element[k] * stride + entry];
    return found;
}

static void scatter(real value, double *values, long stride, long entry, const Work *w)
{
    for (long k = 0; k < LANES && w->block + k < w->of->count; k++) values[(w->block + k) * stride + entry] = value[k];
}

static ALWAYS_INLINE long index_of(long m, long coordinate, long entry) { return entry < 4 ? entry * m + coordinate : 4 * m; }

/* ---- the chain rule */

/* A gradient by y as one by z. */
static ALWAYS_INLINE void by_z(const Work *w, Shape s, const real *by, real *found)
{
    real length = R(0.0);
    for (long k = 0; k < s.m; k++)
        for (long e = 0; e < EACH; e++) {
            real sum = R(0.0);
            for (long o = 0; o < s.each; o++) sum += by[w->entry[k][o]] * w->by_z[k][o * EACH + e];
            if (e < 4)
                found[index_of(s.m, k, e)] = sum;
            else
                length += sum;
        }
    found[s.size - 1] = length;
}

/* what is given of a row at this point, 0 of one that is not among the rows; beside: further ones of an element */
static real given(const Work *w, const double *values, long slot, long beside)
{
    long row = w->of->slots[slot], all = w->of->points * w->of->rows;
    return row < 0 || values == NULL ? R(0.0) : gather(values, all + beside, w->point * w->of->rows + row, w);
}

static real multiplier(const Work *w, long slot) { return given(w, w->wanted.lam, slot, w->of->costs > 0); }
static real stiffness(const Work *w, long slot) { return given(w, w->wanted.stiffness, slot, 0); }

static int active(const Work *w, long slot, long count)
{
    for (long k = 0; k < count; k++)
        if (w->of->slots[slot + k] >= 0) return 1;
    return 0;
}

/* One row: its value and gradient by y. */
static ALWAYS_INLINE void put(Work *w, Shape s, long slot, real value, const real *by)
{
    long row = w->of->slots[slot], all = w->of->points * w->of->rows;
    real found[Z];
    if (row < 0) return;
    row += w->point * w->of->rows;
    if (w->wanted.rows != NULL) scatter(value, w->wanted.rows, all, row, w);
    if (w->wanted.jacobian != NULL) {
        by_z(w, s, by, found);
        for (long e = 0; e < s.size; e++) scatter(found[e], w->wanted.jacobian, all * s.size, row * s.size + e, w);
    }
    if (w->order == 2) {
        real lam = multiplier(w, slot);
        for (long i = 0; i < s.ny; i++) w->phi_by[i] += lam * by[i];
    }
}

/* Add a row's stiffness times the square of its gradient by y. */
static ALWAYS_INLINE void stiffen(Work *w, Shape s, long slot, const real *by)
{
    if (w->wanted.stiffness == NULL || w->of->slots[slot] < 0) return;
    real stiff = stiffness(w, slot);
    for (long i = 0; i < s.ny; i++)
        for (long j = i; j < s.ny; j++) w->bend[i * s.ny + j] += stiff * by[i] * by[j];
}

/* Rows g of quantities v, of which by_v (rows x count) is the Jacobian and v_by the gradients by y; bend (count x count):
 * where their stiffness is added to the second derivatives by v, the upper triangle. */
static ALWAYS_INLINE void put_all(Work *w, Shape s, long slot, long rows, const real *g, const real *by_v, long count,
                                  const real *const *v_by, real *bend)
{
    real by[Y];
    for (long row = 0; row < rows; row++) {
        const real *of = by_v + row * count;
        if (w->of->slots[slot + row] < 0) continue;
        if (w->order > 0)
            for (long i = 0; i < s.ny; i++) {
                by[i] = R(0.0);
                for (long k = 0; k < count; k++) by[i] += of[k] * v_by[k][i];
            }
        put(w, s, slot + row, g[row], by);
        if (w->wanted.stiffness == NULL) continue;
        real stiff = stiffness(w, slot + row);
        for (long k = 0; k < count; k++)
            for (long l = k; l < count; l++) bend[k * count + l] += stiff * of[k] * of[l];
    }
}

/* Add the second derivatives of quantities (upper triangle, count x count) to those by y. */
static ALWAYS_INLINE void push(Work *w, Shape s, const real *bend, long count, const real *const *v_by)
{
    for (long k = 0; k < count; k++) {
        real along[Y];
        for (long i = 0; i < s.ny; i++) {
            along[i] = R(0.0);
            for (long l = 0; l < count; l++) along[i] += bend[k < l ? count * k + l : count * l + k] * v_by[l][i];
        }
        for (long i = 0; i < s.ny; i++)
            for (long j = i; j < s.ny; j++) w->bend[i * s.ny + j] += v_by[k][i] * along[j];
    }
}

/* ---- a point */

static ALWAYS_INLINE void states(Work *w, Shape s)
{
    const Elements *of = w->of;
    real share = R(of->shares[w->point]), hull = R(of->hull && of->shares[w->point] == 0.5);
    for (long k = 0; k < s.m; k++) {
        real z[EACH], x[EACH];
        for (long e = 0; e < EACH; e++) z[e] = w->z[index_of(s.m, k, e)];
        if (s.straight) {
            line_by(&share, &hull, z, w->y, w->by_z[k]);
            continue;
        }
        state_by(&share, z, x, w->by_z[k]);
        long joint = of->moving[k];
        real unit = w->limits[SSM_FREE_D + joint];
        for (long o = 0; o < 3; o++) {
            long entry = 4 * o + joint;
            w->y[entry] = unit * x[o] + (o ? R(0.0) : w->first[joint]);
            for (long e = 0; e < EACH; e++) w->by_z[k][o * EACH + e] *= unit;
            unit /= w->limits[SSM_FREE_TIME_SCALE];
        }
    }
}

static const double *fits_of(const Work *w)
{
    long curves = 4 + 12 * w->of->loads + 1;
    return w->of->fits + w->block * (2 + (SSM_DEGREE + 1) * curves);
}

static void curve_of(const Work *w, long curve, real *found)
{
    memcpy(found, fits_of(w) + LANES * (2 + (SSM_DEGREE + 1) * curve), (SSM_DEGREE + 1) * sizeof(real));
}

static void place_of(const Work *w, real *place) { memcpy(place, fits_of(w), 2 * sizeof(real)); }

/* Efforts of a load, and their gradients by y. */
static void efforts(const Work *w, long load, const real *y, real *tau, real *by)
{
    if (!w->of->straight) {
        real figures[SSM_LOAD];
        for (long k = 0; k < SSM_LOAD; k++) figures[k] = R(w->of->load[load * SSM_LOAD + k]);
        if (w->order)
            torques_by(figures, y, tau, by);
        else
            torques_at(figures, y, tau);
        return;
    }
    real place[2], curve[3 * (SSM_DEGREE + 1)];
    place_of(w, place);
    for (long i = 0; i < 4; i++) {
        for (long k = 0; k < 3; k++)
            curve_of(w, 4 + 4 * (k * w->of->loads + load) + i, curve + k * (SSM_DEGREE + 1));
        if (w->order)
            effort_by(w->limits, place, curve, y, tau + i, by + i * w->shape.ny);
        else
            effort_at(w->limits, place, curve, y, tau + i);
    }
}

static void bend_efforts(const Work *w, long load, const real *y, const real *weight, real *bend)
{
    if (!w->of->straight) {
        real figures[SSM_LOAD];
        for (long k = 0; k < SSM_LOAD; k++) figures[k] = R(w->of->load[load * SSM_LOAD + k]);
        torques_bend(figures, y, weight, bend);
        return;
    }
    real place[2], curve[3 * (SSM_DEGREE + 1)];
    place_of(w, place);
    for (long i = 0; i < 4; i++) {
        for (long k = 0; k < 3; k++)
            curve_of(w, 4 + 4 * (k * w->of->loads + load) + i, curve + k * (SSM_DEGREE + 1));
        effort_bend(w->limits, place, curve, y, weight + i, bend);
    }
}

/* Rates of the joints and of the tool on a path, and where derivatives are taken their gradients by y. */
static void rates_on_path(Work *w)
{
    real place[2], curve[SSM_DEGREE + 1];
    place_of(w, place);
    for (long i = 0; i < 4; i++) {
        curve_of(w, i, curve);
        if (w->order == 0) {
            joint_at(w->limits, place, curve, w->y, w->rate[i]);
            continue;
        }
        real by[4 * EACH];
        memset(by, 0, sizeof by);
        joint_by(w->limits, place, curve, w->y, w->rate[i], by);
        for (long k = 0; k < 4; k++) memcpy(w->rate_by[i][k], by + k * w->shape.ny, (size_t)w->shape.ny * sizeof(real));
    }
    curve_of(w, 4 + 12 * w->of->loads, curve);
    if (w->order == 0)
        speed_at(w->limits, place, curve, w->y, &w->speed);
    else
        speed_by(w->limits, place, curve, w->y, &w->speed, w->speed_by);
}

static void bend_rates_on_path(Work *w)
{
    real place[2], curve[SSM_DEGREE + 1];
    place_of(w, place);
    for (long i = 0; i < 4; i++) {
        curve_of(w, i, curve);
        joint_bend(w->limits, place, curve, w->y, w->rate_weight[i], w->bend);
    }
    curve_of(w, 4 + 12 * w->of->loads, curve);
    speed_bend(w->limits, place, curve, w->y, &w->speed_weight, w->bend);
}

static void rates_of_joints(Work *w)
{
    for (long i = 0; i < 4; i++) {
        w->rate[i][0] = w->rate[i][1] = w->y[4 + i];
        w->rate[i][2] = w->y[8 + i];
        w->rate_by[i][0][4 + i] = w->rate_by[i][1][4 + i] = w->rate_by[i][2][8 + i] = R(1.0);
    }
}

#define POSTURE(name, slot, count)                                                     \
    if (active(w, slot, count)) {                                                      \
        real g[count], by[count * Y], lam[count];                                      \
        memset(by, 0, sizeof by);                                                      \
        if (w->order)                                                                  \
            name##_by(w->prepared, w->y, g, by);                                       \
        else                                                                           \
            name##_at(w->prepared, w->y, g);                                           \
        for (long k = 0; k < count; k++) put(w, s, slot + k, g[k], by + k * Y);        \
        if (w->order == 2) {                                                           \
            for (long k = 0; k < count; k++) {                                         \
                lam[k] = multiplier(w, slot + k);                                      \
                stiffen(w, s, slot + k, by + k * Y);                                   \
            }                                                                          \
            name##_bend(w->prepared, w->y, lam, w->bend);                              \
        }                                                                              \
    }

static void posture_rows(Work *w, Shape s)
{
    POSTURE(tip, 0, 1)
    POSTURE(ranges, 1, 4)
    POSTURE(rates, 5, 6)
    POSTURE(retina, 11, 1)
    POSTURE(lens, 12, 1)
}

static ALWAYS_INLINE void joint_rows(Work *w, Shape s)
{
    const double *limits = w->of->limits;
    if (active(w, 0, 1)) {
        real over = R(1.0 / limits[SSM_STRAIGHT_SPEEDS]), by[Y];
        for (long i = 0; i < s.ny; i++) by[i] = over * w->speed_by[i];
        put(w, s, 0, over * w->speed, by);
        if (w->order == 2) {
            w->speed_weight += over * multiplier(w, 0);
            stiffen(w, s, 0, by);
        }
    }
    for (long i = 0; i < 4; i++) {
        real bounds[4] = {R(limits[SSM_STRAIGHT_VELOCITY + i]), R(limits[SSM_STRAIGHT_ACCELERATION + i]),
                          R(limits[SSM_STRAIGHT_JERK + i]), R(limits[SSM_STRAIGHT_STOP])};
        long slot = 1 + JOINT_ROWS * i;
        for (long side = 0; side <= w->of->undriven[i]; side++) {
            if (!active(w, slot + 3 * side, 3)) continue;
            real sense = w->of->undriven[i] ? R(side ? -1.0 : 1.0) : w->sigma[i];
            real v[3] = {w->rate[i][1], w->rate[i][2], w->speed}, g[3], by[9], lam[3], bend[9];
            const real *v_by[3] = {w->rate_by[i][1], w->rate_by[i][2], w->speed_by};
            memset(by, 0, sizeof by);
            memset(bend, 0, sizeof bend);
            sense_by(bounds, &sense, v, g, by);
            put_all(w, s, slot + 3 * side, 3, g, by, 3, v_by, bend);
            if (w->order < 2) continue;
            for (long k = 0; k < 3; k++) {
                lam[k] = multiplier(w, slot + 3 * side + k);
                w->rate_weight[i][1] += lam[k] * by[3 * k];
                w->rate_weight[i][2] += lam[k] * by[3 * k + 1];
                w->speed_weight += lam[k] * by[3 * k + 2];
            }
            sense_bend(bounds, &sense, v, lam, bend);
            push(w, s, bend, 3, v_by);
        }
        if (!active(w, slot + 6, 4)) continue;
        real v[2] = {w->rate[i][2], w->rate[i][3]}, g[4], by[8], bend[4];
        const real *v_by[2] = {w->rate_by[i][2], w->rate_by[i][3]};
        memset(by, 0, sizeof by);
        memset(bend, 0, sizeof bend);
        pace_by(bounds, v, g, by);
        put_all(w, s, slot + 6, 4, g, by, 2, v_by, bend);
        if (w->order < 2) continue;
        push(w, s, bend, 2, v_by);
        for (long k = 0; k < 4; k++)
            for (long j = 0; j < 2; j++) w->rate_weight[i][2 + j] += multiplier(w, slot + 6 + k) * by[2 * k + j];
    }
}

static ALWAYS_INLINE void actuation_rows(Work *w, Shape s, long a)
{
    const long *actuation = w->of->actuation + 3 * a, i = actuation[0];
    long slot = (s.straight ? STRAIGHT_ACTUATIONS : FREE_ACTUATIONS) + 3 * a;
    const Law *law = TORQUES + actuation[2];
    real figures[SSM_DRIVE], v[3] = {w->tau[i], w->rate[i][0], w->rate[i][2]}, g[3], by[9], lam[3], bend[9];
    const real *v_by[3] = {w->tau_by + i * s.ny, w->rate_by[i][0], w->rate_by[i][2]};
    for (long k = 0; k < SSM_DRIVE; k++) figures[k] = R(w->of->drives[a * SSM_DRIVE + k]);
    if (w->order) {
        memset(by, 0, sizeof by);
        law->by(figures, w->sigma + i, v, g, by);
    } else
        law->at(figures, w->sigma + i, v, g);
    memset(bend, 0, sizeof bend);
    put_all(w, s, slot, 3, g, by, 3, v_by, bend);
    if (w->order < 2) return;
    for (long k = 0; k < 3; k++) {
        lam[k] = multiplier(w, slot + k);
        w->tau_weight[i] += lam[k] * by[3 * k];
        w->rate_weight[i][0] += lam[k] * by[3 * k + 1];
        w->rate_weight[i][2] += lam[k] * by[3 * k + 2];
    }
    law->bend(figures, w->sigma + i, v, lam, bend);
    push(w, s, bend, 3, v_by);
}

/* One motor's part of the cost at the point; factor: of the cost in the Lagrangian. */
static ALWAYS_INLINE void add_cost(Work *w, Shape s, long c, real factor)
{
    long i = w->of->cost[2 * c];
    const Law *law = PULLS + w->of->cost[2 * c + 1];
    real figures[SSM_DRIVE], v[3] = {w->tau[i], w->rate[i][0], w->rate[i][2]}, still[3] = {w->still[i]};
    real t, by[3], bend[9], t_still, by_still[3], excess_by[Y], one = R(1.0), weight = R(w->of->cost_weights[c]);
    const real *v_by[3] = {w->tau_by + i * s.ny, w->rate_by[i][0], w->rate_by[i][2]}, *still_by = w->still_by + i * s.ny;
    for (long k = 0; k < SSM_DRIVE; k++) figures[k] = R(w->of->cost_drives[c * SSM_DRIVE + k]);
    memset(by, 0, sizeof by);
    memset(by_still, 0, sizeof by_still);
    law->by(figures, w->sigma + i, v, &t, by);
    if (w->of->effort) {
        law->by(figures, w->sigma + i, still, &t_still, by_still);
        t -= t_still;
    }
    w->cost += weight * t * t;
    if (w->order == 0) return;
    for (long k = 0; k < s.ny; k++) {
        excess_by[k] = by[0] * v_by[0][k] + by[1] * v_by[1][k] + by[2] * v_by[2][k];
        if (w->of->effort) excess_by[k] -= by_still[0] * still_by[k];
        w->cost_by[k] += R(2.0) * weight * t * excess_by[k];
    }
    if (w->order < 2) return;
    real outer = R(2.0) * weight * factor, slope = outer * t;
    for (long k = 0; k < s.ny; k++)
        for (long l = k; l < s.ny; l++) w->bend[k * s.ny + l] += outer * excess_by[k] * excess_by[l];
    memset(bend, 0, sizeof bend);
    law->bend(figures, w->sigma + i, v, &slope, bend);
    push(w, s, bend, 3, v_by);
    w->tau_weight[i] += slope * by[0];
    w->rate_weight[i][0] += slope * by[1];
    w->rate_weight[i][2] += slope * by[2];
    if (!w->of->effort) return;
    w->still_weight[i] -= slope * by_still[0];
    memset(bend, 0, sizeof bend);
    law->bend(figures, w->sigma + i, still, &one, bend);
    for (long k = 0; k < s.ny; k++)
        for (long l = k; l < s.ny; l++) w->bend[k * s.ny + l] -= slope * bend[0] * still_by[k] * still_by[l];
}

/* Efforts of endlessly slow motion in the same place, by its positions. */
static void efforts_still(Work *w, real *place)
{
    long positions = w->of->straight ? 1 : 4;
    for (long k = 0; k < w->shape.ny; k++) place[k] = k < positions ? w->y[k] : R(0.0);
    efforts(w, 0, place, w->still, w->still_by);
    for (long i = 0; i < 4; i++)
        for (long k = positions; k < w->shape.ny; k++) w->still_by[i * w->shape.ny + k] = R(0.0);
}

static void add_still_bend(Work *w, const real *place)
{
    long positions = w->of->straight ? 1 : 4;
    real bend[Y * Y];
    memset(bend, 0, sizeof bend);
    bend_efforts(w, 0, place, w->still_weight, bend);
    for (long k = 0; k < positions; k++)
        for (long l = k; l < positions; l++) w->bend[k * w->shape.ny + l] += bend[k * w->shape.ny + l];
}

/* Second derivatives by y, and slopes through y, as second derivatives by z. */
static ALWAYS_INLINE void add_hessian(Work *w, Shape s, real factor)
{
    long m = s.m, size = s.size;
    for (long k = 0; k < m; k++)
        for (long l = k; l < m; l++) {
            real half[EACH * EACH];
            for (long o = 0; o < s.each; o++)
                for (long e = 0; e < EACH; e++) {
                    real sum = R(0.0);
                    for (long p = 0; p < s.each; p++) {
                        long a = w->entry[k][o], b = w->entry[l][p];
                        sum += w->bend[a < b ? a * s.ny + b : b * s.ny + a] * w->by_z[l][p * EACH + e];
                    }
                    half[o * EACH + e] = sum;
                }
            for (long d = 0; d < EACH; d++)
                for (long e = 0; e < EACH; e++) {
                    real sum = R(0.0);
                    long a = index_of(s.m, k, d), b = index_of(s.m, l, e);
                    for (long o = 0; o < s.each; o++) sum += w->by_z[k][o * EACH + d] * half[o * EACH + e];
                    w->hessian[a * size + b] += sum;
                    if (k != l) w->hessian[b * size + a] += sum;
                }
        }
    real share = R(w->of->shares[w->point]), hull = R(w->of->hull && w->of->shares[w->point] == 0.5);
    for (long k = 0; k < m; k++) {
        real z[EACH], lam[EACH], bend[EACH * EACH];
        memset(bend, 0, sizeof bend);
        for (long e = 0; e < EACH; e++) z[e] = w->z[index_of(s.m, k, e)];
        for (long o = 0; o < s.each; o++) lam[o] = w->phi_by[w->entry[k][o]];
        if (s.straight) {
            line_bend(&share, &hull, z, lam, bend);
        } else {
            real unit = w->limits[SSM_FREE_D + w->of->moving[k]];
            for (long o = 0; o < 3; o++, unit /= w->limits[SSM_FREE_TIME_SCALE]) lam[o] *= unit;
            state_bend(&share, z, lam, bend);
        }
        for (long d = 0; d < EACH; d++)
            for (long e = d; e < EACH; e++) {
                long a = index_of(s.m, k, d), b = index_of(s.m, k, e);
                w->hessian[a * size + b] += bend[d * EACH + e];
                if (d != e) w->hessian[b * size + a] += bend[d * EACH + e];
            }
    }
    if (w->of->costs) {
        real along[Z];
        by_z(w, s, w->cost_by, along);
        for (long e = 0; e < size; e++) {
            w->hessian[(size - 1) * size + e] += factor * along[e];
            w->hessian[e * size + size - 1] += factor * along[e];
        }
    }
}

static ALWAYS_INLINE void evaluate_point(Work *w, Shape s)
{
    const Elements *of = w->of;
    int costs = w->costs, rows = w->wanted.rows != NULL || w->wanted.jacobian != NULL || w->wanted.hessian != NULL;
    real place[Y], factor = R(0.0), h = w->z[s.size - 1];
    states(w, s);
    if (s.straight) rates_on_path(w); else rates_of_joints(w);
    memset(w->phi_by, 0, sizeof w->phi_by);
    memset(w->cost_by, 0, sizeof w->cost_by);
    w->cost = w->speed_weight = R(0.0);
    if (w->order == 2) {
        memset(w->bend, 0, (size_t)(s.ny * s.ny) * sizeof(real));
        memset(w->rate_weight, 0, sizeof w->rate_weight);
        memset(w->still_weight, 0, sizeof w->still_weight);
    }
    if (costs && w->order == 2)
        factor = R(of->weights[w->point]) * gather(w->wanted.lam, of->points * of->rows + 1, of->points * of->rows, w);
    if (rows && s.straight) joint_rows(w, s);
    if (rows && !s.straight) posture_rows(w, s);
    long slot = s.straight ? STRAIGHT_ACTUATIONS : FREE_ACTUATIONS, first = 0;
    for (long load = 0; load < of->loads; load++) {
        long last = first, wanted = costs && load == 0;
        for (; last < of->actuations && of->actuation[3 * last + 1] == load; last++)
            wanted |= rows && active(w, slot + 3 * last, 3);
        if (wanted) {
            memset(w->tau_weight, 0, sizeof w->tau_weight);
            efforts(w, load, w->y, w->tau, w->tau_by);
            for (long a = first; a < last; a++)
                if (rows && active(w, slot + 3 * a, 3)) actuation_rows(w, s, a);
            if (costs && load == 0) {
                if (of->effort) efforts_still(w, place);
                for (long c = 0; c < of->costs; c++) add_cost(w, s, c, factor * h);
            }
            if (w->order == 2) bend_efforts(w, load, w->y, w->tau_weight, w->bend);
        }
        first = last;
    }
    if (costs) {
        real weight = R(of->weights[w->point]);
        w->integral += weight * h * w->cost;
        if (w->wanted.gradient != NULL) {
            real along[Z];
            by_z(w, s, w->cost_by, along);
            for (long e = 0; e < s.size; e++) w->gradient[e] += weight * h * along[e];
            w->gradient[s.size - 1] += weight * w->cost;
        }
    }
    if (w->order < 2) return;
    if (costs && of->effort) add_still_bend(w, place);
    if (s.straight) bend_rates_on_path(w);
    for (long i = 0; i < s.ny && of->costs; i++) w->phi_by[i] += factor * h * w->cost_by[i];
    add_hessian(w, s, factor);
}

static ALWAYS_INLINE void evaluate_blocks(Work *w, Shape s, const double *z)
{
    const Elements *of = w->of;
    const Wanted *wanted = &w->wanted;
    w->shape = s;
    for (long k = 0; k < s.m; k++)
        for (long o = 0; o < s.each; o++) w->entry[k][o] = s.straight ? o : 4 * o + of->moving[k];
    for (w->block = 0; w->block < of->count; w->block += LANES) {
        for (long k = 0; k < LANES; k++) w->element[k] = w->block + k < of->count ? w->block + k : of->count - 1;
        for (long e = 0; e < s.size; e++) w->z[e] = gather(z, s.size, e, w);
        for (long i = 0; i < 4; i++) w->sigma[i] = gather(of->sigma, 4, i, w);
        if (w->order == 2) memset(w->hessian, 0, (size_t)(s.size * s.size) * sizeof(real));
        memset(w->gradient, 0, sizeof w->gradient);
        w->integral = R(0.0);
        for (w->point = 0; w->point < of->points; w->point++) evaluate_point(w, s);
        for (long e = 0; e < s.size * s.size && wanted->hessian != NULL; e++)
            scatter(w->hessian[e], wanted->hessian, s.size * s.size, e, w);
        for (long e = 0; e < s.size && wanted->gradient != NULL; e++) scatter(w->gradient[e], wanted->gradient, s.size, e, w);
        if (wanted->cost != NULL) scatter(w->integral, wanted->cost, 1, 0, w);
    }
}

static int evaluate(const void *context, const double *z, Wanted wanted)
{
    Work work, *w = &work;
    const Elements *of = context;
    memset(w, 0, sizeof *w);
    w->of = of;
    w->wanted = wanted;
    w->order = wanted.hessian != NULL ? 2 : wanted.jacobian != NULL || wanted.gradient != NULL;
    w->costs = of->costs && (wanted.hessian != NULL || wanted.cost != NULL || wanted.gradient != NULL);
    for (long k = 0; k < (of->straight ? SSM_STRAIGHT_SIZE : SSM_FREE_SIZE); k++) w->limits[k] = R(of->limits[k]);
    if (of->straight) {
        evaluate_blocks(w, (Shape){1, 1, EACH, EACH, 5}, z);
        return 0;
    }
    real mechanism[SSM_MECHANISM], eye[SSM_EYE];
    for (long k = 0; k < SSM_MECHANISM; k++) mechanism[k] = R(of->mechanism[k]);
    for (long k = 0; k < SSM_EYE; k++) eye[k] = R(of->eye[k]);
    prepare(mechanism, eye, w->limits, w->prepared);
    for (long i = 0; i < 4; i++) w->y[i] = w->first[i] = w->limits[SSM_FREE_Q0 + i] + R(i == 1 ? of->offset : 0.0);
    if (of->m == 4)
        evaluate_blocks(w, (Shape){0, 4, Y, 3, Z}, z);
    else
        evaluate_blocks(w, (Shape){0, of->m, Y, 3, 4 * of->m + 1}, z);
    return 0;
}

/* ---- for the structured solver */

SSM_API int ssm_values_of(void *context, const double *z, double *g, double *l)
{
    const Wanted wanted = {.rows = g, .cost = ((const Elements *)context)->costs ? l : NULL};
    return evaluate(context, z, wanted);
}

SSM_API int ssm_derivatives_of(void *context, const double *z, const double *lam, const double *sigma, const Derivatives *found)
{
    const Wanted wanted = {
        .jacobian = found->jacobian,
        .hessian = found->hessian,
        .gradient = ((const Elements *)context)->costs ? found->gradient : NULL,
        .lam = lam,
        .stiffness = sigma,
    };
    return evaluate(context, z, wanted);
}

/* ---- one by one */

SSM_API int ssm_rows_of(void *context, const double *z, double *g)
{
    const Wanted wanted = {.rows = g};
    return evaluate(context, z, wanted);
}

SSM_API int ssm_jacobian_of(void *context, const double *z, double *j)
{
    const Wanted wanted = {.jacobian = j};
    return evaluate(context, z, wanted);
}

SSM_API int ssm_hessian_of(void *context, const double *z, const double *lam, double *h)
{
    const Wanted wanted = {.hessian = h, .lam = lam};
    return evaluate(context, z, wanted);
}

SSM_API int ssm_cost_of(void *context, const double *z, double *l)
{
    const Wanted wanted = {.cost = l};
    return evaluate(context, z, wanted);
}

SSM_API int ssm_gradient_of(void *context, const double *z, double *g)
{
    const Wanted wanted = {.gradient = g};
    return evaluate(context, z, wanted);
}
