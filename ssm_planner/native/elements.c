/* Constraints and costs of the elements of a motion, and their derivatives.
 *
 * A row is one constraint function of an element. Rows and costs are evaluated at several points
 * of an element. kernels.h contains the physical laws, and this file combines them by the chain
 * rule. At a point, rows and costs depend on quantities such as the torques and velocities of the
 * joints (efforts and rates below). These depend on the state y, and y depends on the vector z of
 * the element. In a free motion, y contains q, qd and qdd of all joints. In a motion along a path
 * (called straight), y is x = (s, s', s'', s''', s'_b), see elements/straight_element.py. Times
 * are in the scaled unit of the problem.
 *
 * Four elements are evaluated at once. A number of the type `real` is a vector with one entry for
 * each. */

#include <math.h>
#include <string.h>

#include "native.h"
#include "elements.h"
#include "lanes.h"

#define MOST_Y 12 /* largest length of y */
#define MOST_Z 17 /* largest length of z */
/* Largest number of entries of y, and number of entries of z, that belong to one coordinate. */
#define PER_COORDINATE 5

#define V(name) v_##name
#include "kernels.h"

/* Data of the functions. elements/compiled.py fills the struct and describes its integers. An
 * actuation is one joint's drive with one load (payload). */
typedef struct {
    long straight, count, m, rows, points, loads, actuations, costs, effort, hull;
    const double *shares, *weights; /* fraction of the element, and weight in integrals (points) */
    const long *moving;   /* joint of each coordinate of a free motion */
    const long *undriven; /* 1 for joints that may move in both directions (4) */
    const long *slots;    /* index at a point of each possible row, or -1 if the row is not used */
    const long *actuation; /* joint, load and index in TORQUES of each actuation, sorted by load */
    const double *drives;  /* SSM_DRIVE numbers of the drive of each actuation */
    const long *cost;      /* joint and index in PULLS of each motor in the cost */
    const double *cost_drives, *cost_weights;
    const double *load, *mechanism, *eye, *limits;
    const double *sigma; /* directions of the joints in each element (count x 4) */
    /* Fits of the curves of a path: for each group of LANES elements, the centre and half width of
     * the interval of s, then the coefficients of each curve. The last element fills an incomplete
     * group. */
    const double *fits;
    double offset;
} Elements;

enum { FREE_ACTUATIONS = 13, JOINT_ROWS = 10, STRAIGHT_ACTUATIONS = 1 + 4 * JOINT_ROWS };

/* Functions of a physical law, which elements/kernels.py describes. v are its variables. */
typedef void (*ValueFunction)(const real *drive, const real *sigma, const real *v,
                              real *restrict g);
typedef void (*JacobianFunction)(const real *drive, const real *sigma, const real *v,
                                 real *restrict g, real *restrict by);
typedef void (*HessianFunction)(const real *drive, const real *sigma, const real *v,
                                const real *lam, real *restrict bend);
typedef struct {
    ValueFunction values;
    JacobianFunction jacobian;
    HessianFunction hessian;
} Law;

#define LAW(name) {name##_at, name##_by, name##_bend}
static const Law TORQUES[] = {
    LAW(worm_coulomb),
    LAW(worm_stribeck_exponential),
    LAW(worm_stribeck_gaussian),
    LAW(antibacklash_screw_coulomb),
    LAW(antibacklash_screw_stribeck_exponential),
    LAW(antibacklash_screw_stribeck_gaussian),
};
static const Law PULLS[] = {
    LAW(worm_coulomb_pull),
    LAW(worm_stribeck_exponential_pull),
    LAW(worm_stribeck_gaussian_pull),
    LAW(antibacklash_screw_coulomb_pull),
    LAW(antibacklash_screw_stribeck_exponential_pull),
    LAW(antibacklash_screw_stribeck_gaussian_pull),
};

/* Sizes. They are constants in inlined functions, so that the compiler knows the length of each
 * loop. */
typedef struct {
    int straight;
    /* numbers of coordinates, of entries of y, of those per coordinate, and of entries of z */
    long m, ny, y_per_coordinate, size;
} Shape;

/* Requested outputs, and multipliers of the rows. NULL means that an output is not requested. */
typedef struct {
    /* hessian: that of lam' rows + kappa cost, plus J' diag(stiffness) J */
    double *rows, *jacobian, *hessian;
    double *cost, *gradient;
    const double *lam, *stiffness; /* stiffness NULL means 0 */
} Request;

/* Data and intermediate results of an evaluation. */
typedef struct {
    const Elements *group;
    Request request;
    int order, costs; /* highest order of derivatives; 1 if the cost is needed */
    Shape shape;
    long block, point;
    long element[LANES]; /* elements of the present group, which the last one fills */
    /* data of the mechanism, limits, and joint positions at which the motion begins */
    real prepared[SSM_PREPARED], limits[SSM_FREE_SIZE], first[4];
    /* z and directions of the joints of the elements */
    real z[MOST_Z], sigma[4];
    /* at the point: y, its derivatives by z for each coordinate, and the entries of y that depend
     * on it */
    real y[MOST_Y], by_z[4][PER_COORDINATE * PER_COORDINATE];
    long entry[4][PER_COORDINATE];
    real tau[4], tau_by[4 * MOST_Y], still[4], still_by[4 * MOST_Y];
    real rate[4][4],
        rate_by[4][4][MOST_Y]; /* qd, qd in the velocity rows, qdd, qddd of each joint */
    real speed, speed_by[MOST_Y];
    /* derivatives by y of the Lagrangian and the cost at the point, then their sums over the
     * element */
    real phi_by[MOST_Y], bend[MOST_Y * MOST_Y], cost, cost_by[MOST_Y];
    real tau_weight[4], still_weight[4], rate_weight[4][4], speed_weight;
    real hessian[MOST_Z * MOST_Z], gradient[MOST_Z], integral;
} Work;

/* ---- Transfer between arrays of elements and vectors */

/* Read one entry of an array (elements x stride) for the four elements. */
static real gather(const double *values, long stride, long entry, const Work *w)
{
    real result;
    for (long k = 0; k < LANES; k++) result[k] = values[w->element[k] * stride + entry];
    return result;
}

/* Write one entry of an array (elements x stride) for the four elements. */
static void scatter(real value, double *values, long stride, long entry, const Work *w)
{
    for (long k = 0; k < LANES && w->block + k < w->group->count; k++)
        values[(w->block + k) * stride + entry] = value[k];
}

/* Return the index in z of an entry of a coordinate. Entry 4 is the duration. */
static ALWAYS_INLINE long index_of(long m, long coordinate, long entry)
{ return entry < 4 ? entry * m + coordinate : 4 * m; }

/* ---- The chain rule */

/* Convert a gradient by y to one by z. */
static ALWAYS_INLINE void gradient_by_z(const Work *w, Shape s, const real *by, real *found)
{
    real length = R(0.0);
    for (long k = 0; k < s.m; k++)
        for (long e = 0; e < PER_COORDINATE; e++) {
            real sum = R(0.0);
            for (long o = 0; o < s.y_per_coordinate; o++)
                sum += by[w->entry[k][o]] * w->by_z[k][o * PER_COORDINATE + e];
            if (e < 4)
                found[index_of(s.m, k, e)] = sum;
            else
                length += sum;
        }
    found[s.size - 1] = length;
}

/* Return the entry of `values` for a row at this point, or 0 if the row is not used. beside:
 * number of further entries of each element. */
static real row_input(const Work *w, const double *values, long slot, long beside)
{
    long row = w->group->slots[slot], all = w->group->points * w->group->rows;
    return row < 0 || values == NULL
               ? R(0.0)
               : gather(values, all + beside, w->point * w->group->rows + row, w);
}

/* Return the multiplier of a row. */
static real multiplier(const Work *w, long slot)
{ return row_input(w, w->request.lam, slot, w->group->costs > 0); }
/* Return the stiffness of a row. */
static real stiffness(const Work *w, long slot)
{ return row_input(w, w->request.stiffness, slot, 0); }

/* Return 1 if one of `count` rows from `slot` on is used. */
static int active(const Work *w, long slot, long count)
{
    for (long k = 0; k < count; k++)
        if (w->group->slots[slot + k] >= 0) return 1;
    return 0;
}

/* Store the value of a row and its gradient by z, and add its part of the Lagrangian. by: gradient
 * by y. */
static ALWAYS_INLINE void store_row(Work *w, Shape s, long slot, real value, const real *by)
{
    long row = w->group->slots[slot], all = w->group->points * w->group->rows;
    real found[MOST_Z];
    if (row < 0) return;
    row += w->point * w->group->rows;
    if (w->request.rows != NULL) scatter(value, w->request.rows, all, row, w);
    if (w->request.jacobian != NULL) {
        gradient_by_z(w, s, by, found);
        for (long e = 0; e < s.size; e++)
            scatter(found[e], w->request.jacobian, all * s.size, row * s.size + e, w);
    }
    if (w->order == 2) {
        real lam = multiplier(w, slot);
        for (long i = 0; i < s.ny; i++) w->phi_by[i] += lam * by[i];
    }
}

/* Add stiffness times g g' to the second derivatives by y, where g is the gradient of a row by y.
 */
static ALWAYS_INLINE void add_stiffness(Work *w, Shape s, long slot, const real *by)
{
    if (w->request.stiffness == NULL || w->group->slots[slot] < 0) return;
    real stiff = stiffness(w, slot);
    for (long i = 0; i < s.ny; i++)
        for (long j = i; j < s.ny; j++) w->bend[i * s.ny + j] += stiff * by[i] * by[j];
}

/* Store rows g that depend on quantities v.
 *
 * by_v: Jacobian of g by v (rows x count). v_by: gradients of v by y. bend: upper triangle of the
 * second derivatives by v (count x count), to which the terms of the stiffness are added. */
static ALWAYS_INLINE void store_rows(Work *w, Shape s, long slot, long rows, const real *g,
                                     const real *by_v, long count, const real *const *v_by,
                                     real *bend)
{
    real by[MOST_Y];
    for (long row = 0; row < rows; row++) {
        const real *row_slope = by_v + row * count;
        if (w->group->slots[slot + row] < 0) continue;
        if (w->order > 0)
            for (long i = 0; i < s.ny; i++) {
                by[i] = R(0.0);
                for (long k = 0; k < count; k++) by[i] += row_slope[k] * v_by[k][i];
            }
        store_row(w, s, slot + row, g[row], by);
        if (w->request.stiffness == NULL) continue;
        real stiff = stiffness(w, slot + row);
        for (long k = 0; k < count; k++)
            for (long l = k; l < count; l++)
                bend[k * count + l] += stiff * row_slope[k] * row_slope[l];
    }
}

/* Convert second derivatives by quantities v (upper triangle, count x count) to those by y, and
 * add them. v_by: gradients of v by y. */
static ALWAYS_INLINE void add_curvature(Work *w, Shape s, const real *bend, long count,
                                        const real *const *v_by)
{
    for (long k = 0; k < count; k++) {
        real along[MOST_Y];
        for (long i = 0; i < s.ny; i++) {
            along[i] = R(0.0);
            for (long l = 0; l < count; l++)
                along[i] += bend[k < l ? count * k + l : count * l + k] * v_by[l][i];
        }
        for (long i = 0; i < s.ny; i++)
            for (long j = i; j < s.ny; j++) w->bend[i * s.ny + j] += v_by[k][i] * along[j];
    }
}

/* ---- Evaluation of one point */

/* Compute y and its derivatives by z. */
static ALWAYS_INLINE void compute_states(Work *w, Shape s)
{
    const Elements *group = w->group;
    real share = R(group->shares[w->point]),
         hull = R(group->hull && group->shares[w->point] == 0.5);
    for (long k = 0; k < s.m; k++) {
        real z[PER_COORDINATE], x[PER_COORDINATE];
        for (long e = 0; e < PER_COORDINATE; e++) z[e] = w->z[index_of(s.m, k, e)];
        if (s.straight) {
            line_by(&share, &hull, z, w->y, w->by_z[k]);
            continue;
        }
        state_by(&share, z, x, w->by_z[k]);
        long joint = group->moving[k];
        real unit = w->limits[SSM_FREE_D + joint];
        for (long o = 0; o < 3; o++) {
            long entry = 4 * o + joint;
            w->y[entry] = unit * x[o] + (o ? R(0.0) : w->first[joint]);
            for (long e = 0; e < PER_COORDINATE; e++) w->by_z[k][o * PER_COORDINATE + e] *= unit;
            unit /= w->limits[SSM_FREE_TIME_SCALE];
        }
    }
}

/* Return the fits of the present elements. */
static const double *find_fits(const Work *w)
{
    long curves = 4 + 12 * w->group->loads + 1;
    return w->group->fits + w->block * (2 + (SSM_DEGREE + 1) * curves);
}

/* Copy the coefficients of a curve. */
static void copy_curve(const Work *w, long curve, real *found)
{
    memcpy(found, find_fits(w) + LANES * (2 + (SSM_DEGREE + 1) * curve),
           (SSM_DEGREE + 1) * sizeof(real));
}

/* Copy the centre and the half width of the interval of the fits. */
static void copy_interval(const Work *w, real *interval)
{ memcpy(interval, find_fits(w), 2 * sizeof(real)); }

/* Compute the torques of the four joints with a load, without friction, and their gradients by y.
 */
static void compute_efforts(const Work *w, long load, const real *y, real *tau, real *by)
{
    if (!w->group->straight) {
        real figures[SSM_LOAD];
        for (long k = 0; k < SSM_LOAD; k++) figures[k] = R(w->group->load[load * SSM_LOAD + k]);
        if (w->order)
            torques_by(figures, y, tau, by);
        else
            torques_at(figures, y, tau);
        return;
    }
    real interval[2], curve[3 * (SSM_DEGREE + 1)];
    copy_interval(w, interval);
    for (long i = 0; i < 4; i++) {
        for (long k = 0; k < 3; k++)
            copy_curve(w, 4 + 4 * (k * w->group->loads + load) + i, curve + k * (SSM_DEGREE + 1));
        if (w->order)
            effort_by(w->limits, interval, curve, y, tau + i, by + i * w->shape.ny);
        else
            effort_at(w->limits, interval, curve, y, tau + i);
    }
}

/* Add the second derivatives by y of the sum of weight times torque. */
static void add_effort_hessian(const Work *w, long load, const real *y, const real *weight,
                               real *bend)
{
    if (!w->group->straight) {
        real figures[SSM_LOAD];
        for (long k = 0; k < SSM_LOAD; k++) figures[k] = R(w->group->load[load * SSM_LOAD + k]);
        torques_bend(figures, y, weight, bend);
        return;
    }
    real interval[2], curve[3 * (SSM_DEGREE + 1)];
    copy_interval(w, interval);
    for (long i = 0; i < 4; i++) {
        for (long k = 0; k < 3; k++)
            copy_curve(w, 4 + 4 * (k * w->group->loads + load) + i, curve + k * (SSM_DEGREE + 1));
        effort_bend(w->limits, interval, curve, y, weight + i, bend);
    }
}

/* Compute the velocities, accelerations and jerks of the joints and the tool speed on a path. If
 * derivatives are needed, compute their gradients by y. */
static void compute_path_rates(Work *w)
{
    real interval[2], curve[SSM_DEGREE + 1];
    copy_interval(w, interval);
    for (long i = 0; i < 4; i++) {
        copy_curve(w, i, curve);
        if (w->order == 0) {
            joint_at(w->limits, interval, curve, w->y, w->rate[i]);
            continue;
        }
        real by[4 * PER_COORDINATE];
        memset(by, 0, sizeof by);
        joint_by(w->limits, interval, curve, w->y, w->rate[i], by);
        for (long k = 0; k < 4; k++)
            memcpy(w->rate_by[i][k], by + k * w->shape.ny, (size_t)w->shape.ny * sizeof(real));
    }
    copy_curve(w, 4 + 12 * w->group->loads, curve);
    if (w->order == 0)
        speed_at(w->limits, interval, curve, w->y, &w->speed);
    else
        speed_by(w->limits, interval, curve, w->y, &w->speed, w->speed_by);
}

/* Add the second derivatives of these quantities by y, multiplied by their weights in the
 * Lagrangian. */
static void add_path_rate_hessian(Work *w)
{
    real interval[2], curve[SSM_DEGREE + 1];
    copy_interval(w, interval);
    for (long i = 0; i < 4; i++) {
        copy_curve(w, i, curve);
        joint_bend(w->limits, interval, curve, w->y, w->rate_weight[i], w->bend);
    }
    copy_curve(w, 4 + 12 * w->group->loads, curve);
    speed_bend(w->limits, interval, curve, w->y, &w->speed_weight, w->bend);
}

/* Copy the velocities and accelerations of a free motion from y. */
static void copy_joint_rates(Work *w)
{
    for (long i = 0; i < 4; i++) {
        w->rate[i][0] = w->rate[i][1] = w->y[4 + i];
        w->rate[i][2] = w->y[8 + i];
        w->rate_by[i][0][4 + i] = w->rate_by[i][1][4 + i] = w->rate_by[i][2][8 + i] = R(1.0);
    }
}

/* Store `count` rows of a law `name` that depends only on y. */
#define POSTURE(name, slot, count)                                                                 \
    if (active(w, slot, count)) {                                                                  \
        real g[count], by[count * MOST_Y], lam[count];                                             \
        memset(by, 0, sizeof by);                                                                  \
        if (w->order)                                                                              \
            name##_by(w->prepared, w->y, g, by);                                                   \
        else                                                                                       \
            name##_at(w->prepared, w->y, g);                                                       \
        for (long k = 0; k < count; k++) store_row(w, s, slot + k, g[k], by + k * MOST_Y);         \
        if (w->order == 2) {                                                                       \
            for (long k = 0; k < count; k++) {                                                     \
                lam[k] = multiplier(w, slot + k);                                                  \
                add_stiffness(w, s, slot + k, by + k * MOST_Y);                                    \
            }                                                                                      \
            name##_bend(w->prepared, w->y, lam, w->bend);                                          \
        }                                                                                          \
    }

/* Store the rows of the tool: tip speed, ranges, rates, and clearances from retina and lens. */
static void store_posture_rows(Work *w, Shape s)
{
    POSTURE(tip, 0, 1)
    POSTURE(ranges, 1, 4)
    POSTURE(rates, 5, 6)
    POSTURE(retina, 11, 1)
    POSTURE(lens, 12, 1)
}

/* Store the kinematic rows of a motion along a path. */
static ALWAYS_INLINE void store_joint_rows(Work *w, Shape s)
{
    const double *limits = w->group->limits;
    if (active(w, 0, 1)) {
        real over = R(1.0 / limits[SSM_STRAIGHT_SPEEDS]), by[MOST_Y];
        for (long i = 0; i < s.ny; i++) by[i] = over * w->speed_by[i];
        store_row(w, s, 0, over * w->speed, by);
        if (w->order == 2) {
            w->speed_weight += over * multiplier(w, 0);
            add_stiffness(w, s, 0, by);
        }
    }
    for (long i = 0; i < 4; i++) {
        real bounds[4] = {R(limits[SSM_STRAIGHT_VELOCITY + i]),
                          R(limits[SSM_STRAIGHT_ACCELERATION + i]),
                          R(limits[SSM_STRAIGHT_JERK + i]), R(limits[SSM_STRAIGHT_STOP])};
        long slot = 1 + JOINT_ROWS * i;
        for (long side = 0; side <= w->group->undriven[i]; side++) {
            if (!active(w, slot + 3 * side, 3)) continue;
            real sense = w->group->undriven[i] ? R(side ? -1.0 : 1.0) : w->sigma[i];
            real v[3] = {w->rate[i][1], w->rate[i][2], w->speed}, g[3], by[9], lam[3], bend[9];
            const real *v_by[3] = {w->rate_by[i][1], w->rate_by[i][2], w->speed_by};
            memset(by, 0, sizeof by);
            memset(bend, 0, sizeof bend);
            sense_by(bounds, &sense, v, g, by);
            store_rows(w, s, slot + 3 * side, 3, g, by, 3, v_by, bend);
            if (w->order < 2) continue;
            for (long k = 0; k < 3; k++) {
                lam[k] = multiplier(w, slot + 3 * side + k);
                w->rate_weight[i][1] += lam[k] * by[3 * k];
                w->rate_weight[i][2] += lam[k] * by[3 * k + 1];
                w->speed_weight += lam[k] * by[3 * k + 2];
            }
            sense_bend(bounds, &sense, v, lam, bend);
            add_curvature(w, s, bend, 3, v_by);
        }
        if (!active(w, slot + 6, 4)) continue;
        real v[2] = {w->rate[i][2], w->rate[i][3]}, g[4], by[8], bend[4];
        const real *v_by[2] = {w->rate_by[i][2], w->rate_by[i][3]};
        memset(by, 0, sizeof by);
        memset(bend, 0, sizeof bend);
        pace_by(bounds, v, g, by);
        store_rows(w, s, slot + 6, 4, g, by, 2, v_by, bend);
        if (w->order < 2) continue;
        add_curvature(w, s, bend, 2, v_by);
        for (long k = 0; k < 4; k++)
            for (long j = 0; j < 2; j++)
                w->rate_weight[i][2 + j] += multiplier(w, slot + 6 + k) * by[2 * k + j];
    }
}

/* Store the three rows of actuation a. */
static ALWAYS_INLINE void store_actuation_rows(Work *w, Shape s, long a)
{
    const long *actuation = w->group->actuation + 3 * a, i = actuation[0];
    long slot = (s.straight ? STRAIGHT_ACTUATIONS : FREE_ACTUATIONS) + 3 * a;
    const Law *law = TORQUES + actuation[2];
    real figures[SSM_DRIVE], v[3] = {w->tau[i], w->rate[i][0], w->rate[i][2]}, g[3], by[9], lam[3],
                             bend[9];
    const real *v_by[3] = {w->tau_by + i * s.ny, w->rate_by[i][0], w->rate_by[i][2]};
    for (long k = 0; k < SSM_DRIVE; k++) figures[k] = R(w->group->drives[a * SSM_DRIVE + k]);
    if (w->order) {
        memset(by, 0, sizeof by);
        law->jacobian(figures, w->sigma + i, v, g, by);
    } else
        law->values(figures, w->sigma + i, v, g);
    memset(bend, 0, sizeof bend);
    store_rows(w, s, slot, 3, g, by, 3, v_by, bend);
    if (w->order < 2) return;
    for (long k = 0; k < 3; k++) {
        lam[k] = multiplier(w, slot + k);
        w->tau_weight[i] += lam[k] * by[3 * k];
        w->rate_weight[i][0] += lam[k] * by[3 * k + 1];
        w->rate_weight[i][2] += lam[k] * by[3 * k + 2];
    }
    law->hessian(figures, w->sigma + i, v, lam, bend);
    add_curvature(w, s, bend, 3, v_by);
}

/* Add the squared torque of motor c to the cost. If the cost is the effort, subtract the torque of
 * an endlessly slow motion first. factor: factor of the cost in the Lagrangian. */
static ALWAYS_INLINE void add_cost(Work *w, Shape s, long c, real factor)
{
    long i = w->group->cost[2 * c];
    const Law *law = PULLS + w->group->cost[2 * c + 1];
    real figures[SSM_DRIVE], v[3] = {w->tau[i], w->rate[i][0], w->rate[i][2]},
                             still[3] = {w->still[i]};
    real t, by[3], bend[9], t_still, by_still[3], excess_by[MOST_Y],
        one = R(1.0), weight = R(w->group->cost_weights[c]);
    const real *v_by[3] = {w->tau_by + i * s.ny, w->rate_by[i][0], w->rate_by[i][2]},
               *still_by = w->still_by + i * s.ny;
    for (long k = 0; k < SSM_DRIVE; k++) figures[k] = R(w->group->cost_drives[c * SSM_DRIVE + k]);
    memset(by, 0, sizeof by);
    memset(by_still, 0, sizeof by_still);
    law->jacobian(figures, w->sigma + i, v, &t, by);
    if (w->group->effort) {
        law->jacobian(figures, w->sigma + i, still, &t_still, by_still);
        t -= t_still;
    }
    w->cost += weight * t * t;
    if (w->order == 0) return;
    for (long k = 0; k < s.ny; k++) {
        excess_by[k] = by[0] * v_by[0][k] + by[1] * v_by[1][k] + by[2] * v_by[2][k];
        if (w->group->effort) excess_by[k] -= by_still[0] * still_by[k];
        w->cost_by[k] += R(2.0) * weight * t * excess_by[k];
    }
    if (w->order < 2) return;
    real outer = R(2.0) * weight * factor, slope = outer * t;
    for (long k = 0; k < s.ny; k++)
        for (long l = k; l < s.ny; l++)
            w->bend[k * s.ny + l] += outer * excess_by[k] * excess_by[l];
    memset(bend, 0, sizeof bend);
    law->hessian(figures, w->sigma + i, v, &slope, bend);
    add_curvature(w, s, bend, 3, v_by);
    w->tau_weight[i] += slope * by[0];
    w->rate_weight[i][0] += slope * by[1];
    w->rate_weight[i][2] += slope * by[2];
    if (!w->group->effort) return;
    w->still_weight[i] -= slope * by_still[0];
    memset(bend, 0, sizeof bend);
    law->hessian(figures, w->sigma + i, still, &one, bend);
    for (long k = 0; k < s.ny; k++)
        for (long l = k; l < s.ny; l++)
            w->bend[k * s.ny + l] -= slope * bend[0] * still_by[k] * still_by[l];
}

/* Compute the torques of an endlessly slow motion through the same position. still_y receives its
 * y. */
static void compute_still_efforts(Work *w, real *still_y)
{
    long positions = w->group->straight ? 1 : 4;
    for (long k = 0; k < w->shape.ny; k++) still_y[k] = k < positions ? w->y[k] : R(0.0);
    compute_efforts(w, 0, still_y, w->still, w->still_by);
    for (long i = 0; i < 4; i++)
        for (long k = positions; k < w->shape.ny; k++) w->still_by[i * w->shape.ny + k] = R(0.0);
}

/* Add the second derivatives of these torques, multiplied by their weights in the Lagrangian. */
static void add_still_hessian(Work *w, const real *still_y)
{
    long positions = w->group->straight ? 1 : 4;
    real bend[MOST_Y * MOST_Y];
    memset(bend, 0, sizeof bend);
    add_effort_hessian(w, 0, still_y, w->still_weight, bend);
    for (long k = 0; k < positions; k++)
        for (long l = k; l < positions; l++)
            w->bend[k * w->shape.ny + l] += bend[k * w->shape.ny + l];
}

/* Convert the derivatives of the Lagrangian by y to second derivatives by z, and add them. factor:
 * factor of the cost in the Lagrangian. */
static ALWAYS_INLINE void add_hessian(Work *w, Shape s, real factor)
{
    long m = s.m, size = s.size;
    for (long k = 0; k < m; k++)
        for (long l = k; l < m; l++) {
            real half[PER_COORDINATE * PER_COORDINATE];
            for (long o = 0; o < s.y_per_coordinate; o++)
                for (long e = 0; e < PER_COORDINATE; e++) {
                    real sum = R(0.0);
                    for (long p = 0; p < s.y_per_coordinate; p++) {
                        long a = w->entry[k][o], b = w->entry[l][p];
                        sum += w->bend[a < b ? a * s.ny + b : b * s.ny + a] *
                               w->by_z[l][p * PER_COORDINATE + e];
                    }
                    half[o * PER_COORDINATE + e] = sum;
                }
            for (long d = 0; d < PER_COORDINATE; d++)
                for (long e = 0; e < PER_COORDINATE; e++) {
                    real sum = R(0.0);
                    long a = index_of(s.m, k, d), b = index_of(s.m, l, e);
                    for (long o = 0; o < s.y_per_coordinate; o++)
                        sum += w->by_z[k][o * PER_COORDINATE + d] * half[o * PER_COORDINATE + e];
                    w->hessian[a * size + b] += sum;
                    if (k != l) w->hessian[b * size + a] += sum;
                }
        }
    real share = R(w->group->shares[w->point]),
         hull = R(w->group->hull && w->group->shares[w->point] == 0.5);
    for (long k = 0; k < m; k++) {
        real z[PER_COORDINATE], lam[PER_COORDINATE], bend[PER_COORDINATE * PER_COORDINATE];
        memset(bend, 0, sizeof bend);
        for (long e = 0; e < PER_COORDINATE; e++) z[e] = w->z[index_of(s.m, k, e)];
        for (long o = 0; o < s.y_per_coordinate; o++) lam[o] = w->phi_by[w->entry[k][o]];
        if (s.straight) {
            line_bend(&share, &hull, z, lam, bend);
        } else {
            real unit = w->limits[SSM_FREE_D + w->group->moving[k]];
            for (long o = 0; o < 3; o++, unit /= w->limits[SSM_FREE_TIME_SCALE]) lam[o] *= unit;
            state_bend(&share, z, lam, bend);
        }
        for (long d = 0; d < PER_COORDINATE; d++)
            for (long e = d; e < PER_COORDINATE; e++) {
                long a = index_of(s.m, k, d), b = index_of(s.m, k, e);
                w->hessian[a * size + b] += bend[d * PER_COORDINATE + e];
                if (d != e) w->hessian[b * size + a] += bend[d * PER_COORDINATE + e];
            }
    }
    if (w->group->costs) {
        real along[MOST_Z];
        gradient_by_z(w, s, w->cost_by, along);
        for (long e = 0; e < size; e++) {
            w->hessian[(size - 1) * size + e] += factor * along[e];
            w->hessian[e * size + size - 1] += factor * along[e];
        }
    }
}

/* Evaluate all rows and the cost at one point. */
static ALWAYS_INLINE void evaluate_point(Work *w, Shape s)
{
    const Elements *group = w->group;
    int costs = w->costs,
        rows = w->request.rows != NULL || w->request.jacobian != NULL || w->request.hessian != NULL;
    real still_y[MOST_Y], factor = R(0.0), h = w->z[s.size - 1];
    compute_states(w, s);
    if (s.straight)
        compute_path_rates(w);
    else
        copy_joint_rates(w);
    memset(w->phi_by, 0, sizeof w->phi_by);
    memset(w->cost_by, 0, sizeof w->cost_by);
    w->cost = w->speed_weight = R(0.0);
    if (w->order == 2) {
        memset(w->bend, 0, (size_t)(s.ny * s.ny) * sizeof(real));
        memset(w->rate_weight, 0, sizeof w->rate_weight);
        memset(w->still_weight, 0, sizeof w->still_weight);
    }
    if (costs && w->order == 2)
        factor =
            R(group->weights[w->point]) *
            gather(w->request.lam, group->points * group->rows + 1, group->points * group->rows, w);
    if (rows && s.straight) store_joint_rows(w, s);
    if (rows && !s.straight) store_posture_rows(w, s);
    long slot = s.straight ? STRAIGHT_ACTUATIONS : FREE_ACTUATIONS, first = 0;
    for (long load = 0; load < group->loads; load++) {
        long last = first, is_needed = costs && load == 0;
        for (; last < group->actuations && group->actuation[3 * last + 1] == load; last++)
            is_needed |= rows && active(w, slot + 3 * last, 3);
        if (is_needed) {
            memset(w->tau_weight, 0, sizeof w->tau_weight);
            compute_efforts(w, load, w->y, w->tau, w->tau_by);
            for (long a = first; a < last; a++)
                if (rows && active(w, slot + 3 * a, 3)) store_actuation_rows(w, s, a);
            if (costs && load == 0) {
                if (group->effort) compute_still_efforts(w, still_y);
                for (long c = 0; c < group->costs; c++) add_cost(w, s, c, factor * h);
            }
            if (w->order == 2) add_effort_hessian(w, load, w->y, w->tau_weight, w->bend);
        }
        first = last;
    }
    if (costs) {
        real weight = R(group->weights[w->point]);
        w->integral += weight * h * w->cost;
        if (w->request.gradient != NULL) {
            real along[MOST_Z];
            gradient_by_z(w, s, w->cost_by, along);
            for (long e = 0; e < s.size; e++) w->gradient[e] += weight * h * along[e];
            w->gradient[s.size - 1] += weight * w->cost;
        }
    }
    if (w->order < 2) return;
    if (costs && group->effort) add_still_hessian(w, still_y);
    if (s.straight) add_path_rate_hessian(w);
    for (long i = 0; i < s.ny && group->costs; i++) w->phi_by[i] += factor * h * w->cost_by[i];
    add_hessian(w, s, factor);
}

/* Evaluate all elements, four at once. */
static ALWAYS_INLINE void evaluate_blocks(Work *w, Shape s, const double *z)
{
    const Elements *group = w->group;
    const Request *request = &w->request;
    w->shape = s;
    for (long k = 0; k < s.m; k++)
        for (long o = 0; o < s.y_per_coordinate; o++)
            w->entry[k][o] = s.straight ? o : 4 * o + group->moving[k];
    for (w->block = 0; w->block < group->count; w->block += LANES) {
        for (long k = 0; k < LANES; k++)
            w->element[k] = w->block + k < group->count ? w->block + k : group->count - 1;
        for (long e = 0; e < s.size; e++) w->z[e] = gather(z, s.size, e, w);
        for (long i = 0; i < 4; i++) w->sigma[i] = gather(group->sigma, 4, i, w);
        if (w->order == 2) memset(w->hessian, 0, (size_t)(s.size * s.size) * sizeof(real));
        memset(w->gradient, 0, sizeof w->gradient);
        w->integral = R(0.0);
        for (w->point = 0; w->point < group->points; w->point++) evaluate_point(w, s);
        for (long e = 0; e < s.size * s.size && request->hessian != NULL; e++)
            scatter(w->hessian[e], request->hessian, s.size * s.size, e, w);
        for (long e = 0; e < s.size && request->gradient != NULL; e++)
            scatter(w->gradient[e], request->gradient, s.size, e, w);
        if (request->cost != NULL) scatter(w->integral, request->cost, 1, 0, w);
    }
}

/* Compute the requested outputs at z (count x size_z). Return 0. */
static int evaluate(const void *context, const double *z, Request request)
{
    Work work, *w = &work;
    const Elements *group = context;
    memset(w, 0, sizeof *w);
    w->group = group;
    w->request = request;
    w->order = request.hessian != NULL ? 2 : request.jacobian != NULL || request.gradient != NULL;
    w->costs = group->costs &&
               (request.hessian != NULL || request.cost != NULL || request.gradient != NULL);
    for (long k = 0; k < (group->straight ? SSM_STRAIGHT_SIZE : SSM_FREE_SIZE); k++)
        w->limits[k] = R(group->limits[k]);
    if (group->straight) {
        evaluate_blocks(w, (Shape){1, 1, PER_COORDINATE, PER_COORDINATE, 5}, z);
        return 0;
    }
    real mechanism[SSM_MECHANISM], eye[SSM_EYE];
    for (long k = 0; k < SSM_MECHANISM; k++) mechanism[k] = R(group->mechanism[k]);
    for (long k = 0; k < SSM_EYE; k++) eye[k] = R(group->eye[k]);
    prepare(mechanism, eye, w->limits, w->prepared);
    for (long i = 0; i < 4; i++)
        w->y[i] = w->first[i] = w->limits[SSM_FREE_Q0 + i] + R(i == 1 ? group->offset : 0.0);
    if (group->m == 4)
        evaluate_blocks(w, (Shape){0, 4, MOST_Y, 3, MOST_Z}, z);
    else
        evaluate_blocks(w, (Shape){0, group->m, MOST_Y, 3, 4 * group->m + 1}, z);
    return 0;
}

/* ---- Functions for the structured solver, see ElementGroup in elements.h */

SSM_API int ssm_values_of(void *context, const double *z, double *g, double *l)
{
    const Request request = {.rows = g, .cost = ((const Elements *)context)->costs ? l : NULL};
    return evaluate(context, z, request);
}

SSM_API int ssm_derivatives_of(void *context, const double *z, const double *lam,
                               const double *sigma, const Derivatives *found)
{
    const Request request = {
        .jacobian = found->jacobian,
        .hessian = found->hessian,
        .gradient = ((const Elements *)context)->costs ? found->gradient : NULL,
        .lam = lam,
        .stiffness = sigma,
    };
    return evaluate(context, z, request);
}

/* ---- Functions that compute one output each. The Hessian is that of lam' rows + kappa cost. */

SSM_API int ssm_rows_of(void *context, const double *z, double *g)
{
    const Request request = {.rows = g};
    return evaluate(context, z, request);
}

SSM_API int ssm_jacobian_of(void *context, const double *z, double *j)
{
    const Request request = {.jacobian = j};
    return evaluate(context, z, request);
}

SSM_API int ssm_hessian_of(void *context, const double *z, const double *lam, double *h)
{
    const Request request = {.hessian = h, .lam = lam};
    return evaluate(context, z, request);
}

SSM_API int ssm_cost_of(void *context, const double *z, double *l)
{
    const Request request = {.cost = l};
    return evaluate(context, z, request);
}

SSM_API int ssm_gradient_of(void *context, const double *z, double *g)
{
    const Request request = {.gradient = g};
    return evaluate(context, z, request);
}
