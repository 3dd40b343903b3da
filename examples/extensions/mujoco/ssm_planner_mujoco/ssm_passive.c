/*
 * Motors of robot.xml with the exact friction of their drives, and the position loops of the plan.
 *
 * A spring connects every motor shaft to its joint. The law of the drive determines the speed of
 * the shaft after the time step, and the force on the shaft is the one that leads to this speed. A
 * drive that sticks therefore stands exactly still. This requires the integrator Euler.
 *
 * A joint without a drive has the speed that its control states, in rad/s or m/s.
 *
 * Install ssm_passive as mjcb_passive, or load this library as a plugin of MuJoCo and add
 * <extension><plugin plugin="ssm.drives"><instance name="ssm"/></plugin></extension> to the model.
 */
#include <mujoco/mujoco.h>
#include "ssm_drives.h"

/* From ssm_trajectory.c, whose name tells whether the plan is verified. */
void ssm_sample(ssm_real t, ssm_real q[4], ssm_real qd[4], ssm_real qdd[4], ssm_real tau_motor[4]);

/* Slower motors are at rest, rad/s. Rounding errors of the integrator are smaller. */
static const double still = 1e-9;
/* Time at rest, s, of a drive that has not moved since the start. */
static const double long_rest = 1e6;
/* Bandwidth of the position loops, rad/s. */
static const double bandwidth = 2.0 * 3.141592653589793 * 100.0;

/* Entries of mjData.userdata: the last time at which each drive moved (0: never), and the angle
   of each motor at joint position 0. */
enum { MOVED = 0, ZERO = 4, USED = 8 };

/* Addresses of a joint, of its shaft and of its motor in the model. */
typedef struct {
    int q, v, shaft_q, shaft_v, motor;
} place;

/* Finds the parts of the robot. Returns 0 for another model. */
static int find(const mjModel *m, place where[4])
{
    for (int k = 0; k < 4; ++k) {
        const int joint = mj_name2id(m, mjOBJ_JOINT, ssm_joint_name[k]);
        const int shaft = mj_name2id(m, mjOBJ_JOINT, ssm_shaft_name[k]);
        const int motor = mj_name2id(m, mjOBJ_ACTUATOR, ssm_joint_name[k]);
        if (joint < 0 || shaft < 0 || motor < 0 || m->nuserdata < USED) {
            return 0;
        }
        where[k] = (place){m->jnt_qposadr[joint], m->jnt_dofadr[joint], m->jnt_qposadr[shaft],
                           m->jnt_dofadr[shaft], motor};
    }
    return 1;
}

static void add_forces(const mjModel *m, mjData *d)
{
    double speed[4], rest[4], torque[4], load[4] = {0.0}, after[4];
    place where[4];
    if (!find(m, where)) {
        return;
    }
    for (int k = 0; k < 4; ++k) {
        const place p = where[k];
        const double w = d->qvel[p.shaft_v], ratio = ssm_drive_constants[RATIO][k];
        const double *range = m->actuator_ctrlrange + 2 * p.motor;
        speed[k] = fabs(w) < still ? 0.0 : w;
        torque[k] = d->ctrl[p.motor];
        if (m->actuator_ctrllimited[p.motor]) {
            torque[k] = fmin(fmax(torque[k], range[0]), range[1]);
        }
        if (speed[k] != 0.0) {
            d->userdata[MOVED + k] = d->time;
        }
        rest[k] = d->userdata[MOVED + k] > 0.0 ? d->time - d->userdata[MOVED + k] : long_rest;
        if (ratio > 0.0) {
            const double play = ssm_drive_constants[FREE_PLAY][k];
            const double twist = d->qpos[p.shaft_q] / ratio - d->qpos[p.q];
            const double stretch = twist - fmin(fmax(twist, -play), play);
            const double damper = ssm_drive_constants[DAMPING][k] * (w / ratio - d->qvel[p.v]);
            load[k] = ssm_drive_constants[STIFFNESS][k] * stretch + (stretch != 0.0 ? damper : 0.0);
            d->qfrc_passive[p.v] += load[k];
        }
    }
    ssm_drive_speeds(speed, rest, torque, load, m->opt.timestep, after);
    for (int k = 0; k < 4; ++k) {
        const double change = (after[k] - d->qvel[where[k].shaft_v]) / m->opt.timestep;
        d->qfrc_passive[where[k].shaft_v] += ssm_drive_constants[INERTIA][k] * change - torque[k];
    }
}

static const char plugin_name[] = "ssm.drives";

/* The force as mjcb_passive. A model with the plugin has it already. */
void ssm_passive(const mjModel *m, mjData *d)
{
    int slot = -1;
    mjp_getPlugin(plugin_name, &slot);
    for (int k = 0; k < m->nplugin; ++k) {
        if (m->plugin[k] == slot) {
            return;
        }
    }
    add_forces(m, d);
}

/* Follows the plan, as mjcb_control: torque of the exact law, and proportional-derivative loops. */
void ssm_control(const mjModel *m, mjData *d)
{
    double q[4], qd[4], qdd[4], torque[4], next[4], unused[3][4];
    place where[4];
    if (!find(m, where)) {
        return;
    }
    ssm_sample(d->time, q, qd, qdd, torque);
    ssm_sample(d->time + m->opt.timestep, next, unused[0], unused[1], NULL);
    for (int k = 0; k < 4; ++k) {
        const place p = where[k];
        const double ratio = ssm_drive_constants[RATIO][k], w = d->qvel[p.shaft_v];
        const double error = ratio * q[k] + d->userdata[ZERO + k] - d->qpos[p.shaft_q];
        const double acceleration = bandwidth * (bandwidth * error + 1.4 * (ratio * qd[k] - w));
        d->ctrl[p.motor] = ratio > 0.0
            ? torque[k] + ssm_drive_constants[INERTIA][k] * acceleration
            : (next[k] - d->qpos[p.q]) / m->opt.timestep;
    }
}

static int none(const mjModel *m, int instance)
{
    (void)m, (void)instance;
    return 0;
}

static int init(const mjModel *m, mjData *d, int instance)
{
    (void)m, (void)d, (void)instance;
    return 0;
}

static void reset(const mjModel *m, mjtNum *state, void *data, int instance)
{
    (void)m, (void)state, (void)data, (void)instance;
}

static void compute(const mjModel *m, mjData *d, int instance, int capability)
{
    (void)instance, (void)capability;
    add_forces(m, d);
}

mjPLUGIN_LIB_INIT(ssm_drives)
{
    mjpPlugin plugin;
    int slot;
    if (mjp_getPlugin(plugin_name, &slot)) {
        return; /* the process has loaded another copy */
    }
    mjp_defaultPlugin(&plugin);
    plugin.name = plugin_name;
    plugin.capabilityflags = mjPLUGIN_PASSIVE;
    plugin.nstate = none;
    plugin.init = init;
    plugin.reset = reset;
    plugin.compute = compute;
    mjp_registerPlugin(&plugin);
}
