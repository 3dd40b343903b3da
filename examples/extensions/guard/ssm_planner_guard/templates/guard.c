{{ comment }}
#include "{{ header }}"

#include <math.h>
#include <string.h>

/* Set points, and measurements of velocity and torque, in a row of the memory. */
enum { POSITION, VELOCITY, LOW, HIGH, SPEED, TORQUE };

static const ssm_real period = {{ period }}, lag = {{ lag }};
static const int driven[4] = { {{- driven | join(", ") -}} };
{% for name, values in tables.items() %}
static const ssm_real {{ name }}[4] = { {{- values | join(", ") -}} };
{% endfor %}

void ssm_guard_start(ssm_guard *guard)
{
    memset(guard, 0, sizeof *guard);
    guard->joint = -1;
}

static int raise_alarm(ssm_guard *guard, int cause, int joint, ssm_real value, ssm_real bound)
{
    guard->cause = cause;
    guard->joint = joint;
    guard->value = value;
    guard->bound = bound;
    return cause;
}

/* Raises an alarm if a value is not between two bounds. */
static int outside(ssm_guard *guard, int cause, int joint, ssm_real value, ssm_real low,
                   ssm_real high)
{
    if (value >= low && value <= high) {
        return SSM_GUARD_NONE;
    }
    return raise_alarm(guard, cause, joint, value, value < low ? low : high);
}

/* Judges one joint. */
static int judge(ssm_guard *guard, int j, ssm_real time, const ssm_guard_sample *sample)
{
    const int count = guard->ticks < SSM_GUARD_ROWS ? (int)guard->ticks : SSM_GUARD_ROWS;
    const ssm_real q = sample->q[j], qd = sample->qd[j], tau = sample->tau[j];
    const ssm_real age = time - sample->time[j];
    const ssm_real position = position_margin[j], velocity = velocity_margin[j];
    const ssm_real torque = torque_margin[j];
    const ssm_real top = velocity_max[j] + velocity, peak = torque_max[j] + torque_noise[j];
    ssm_real least[4], most[4], speed = SSM_R(0.0), mean = SSM_R(0.0);
    int finite = isfinite(q) && isfinite(qd) && isfinite(tau), moving, cause;
    if (age < SSM_R(0.0)) {
        return raise_alarm(guard, SSM_GUARD_CLOCK, j, -age, SSM_R(0.0));
    }
    if (!(age <= lag)) {
        return raise_alarm(guard, SSM_GUARD_LATE, j, age, lag);
    }
    for (int quantity = POSITION; quantity <= HIGH; ++quantity) {
        least[quantity] = most[quantity] = guard->rows[0][quantity][j];
    }
    for (int row = 0; row < count; ++row) {
        for (int quantity = POSITION; quantity <= HIGH; ++quantity) {
            const ssm_real value = guard->rows[row][quantity][j];
            finite = finite && isfinite(value);
            least[quantity] = value < least[quantity] ? value : least[quantity];
            most[quantity] = value > most[quantity] ? value : most[quantity];
        }
        speed += guard->rows[row][SPEED][j] / (ssm_real)count;
        mean += guard->rows[row][TORQUE][j] / (ssm_real)count;
    }
    if (!finite || !isfinite(speed) || !isfinite(mean)) {
        return raise_alarm(guard, SSM_GUARD_NOT_A_NUMBER, j, NAN, SSM_R(0.0));
    }
    cause = outside(guard, SSM_GUARD_POSITION_LIMIT, j, q, position_min[j] - position,
                    position_max[j] + position);
    if (!cause) {
        cause = outside(guard, SSM_GUARD_VELOCITY_LIMIT, j, speed, -top, top);
    }
    if (!cause) {
        cause = outside(guard, SSM_GUARD_TORQUE_LIMIT, j, tau, -peak, peak);
    }
    if (!cause) {
        cause = outside(guard, SSM_GUARD_PATH, j, q, least[POSITION] - position,
                        most[POSITION] + position);
    }
    if (!cause) {
        cause = outside(guard, SSM_GUARD_SPEED, j, speed, least[VELOCITY] - velocity,
                        most[VELOCITY] + velocity);
    }
    /* A joint that may be at rest has any torque that its friction holds. */
    moving = count == SSM_GUARD_ROWS && (least[VELOCITY] > velocity || most[VELOCITY] < -velocity);
    if (!cause && moving) {
        cause = outside(guard, SSM_GUARD_TORQUE, j, mean, least[LOW] - torque, most[HIGH] + torque);
    }
    return cause;
}

int ssm_guard_tick(ssm_guard *guard, ssm_real time, const ssm_real q[4], const ssm_real qd[4],
                   const ssm_real qdd[4], const ssm_guard_sample *sample)
{
    static const ssm_real none[4] = {SSM_R(0.0), SSM_R(0.0), SSM_R(0.0), SSM_R(0.0)};
    const ssm_real passed = guard->ticks ? time - guard->time : period;
    const unsigned long row = guard->ticks % SSM_GUARD_ROWS;
    ssm_real tau[4];
    if (guard->cause != SSM_GUARD_NONE) {
        return guard->cause;
    }
    if (!(passed > SSM_R(0.0)) || !isfinite(time)) {
        return raise_alarm(guard, SSM_GUARD_CLOCK, -1, passed, SSM_R(0.0));
    }
    if (passed > lag) {
        return raise_alarm(guard, SSM_GUARD_LATE, -1, passed, lag);
    }
    ssm_motor_torque(q, qd, qdd, none, tau);
    for (int j = 0; j < 4; ++j) {
        const ssm_real spread = torque_spread[j] * SSM_F(fabs)(tau[j]);
        guard->rows[row][POSITION][j] = q[j];
        guard->rows[row][VELOCITY][j] = qd[j];
        guard->rows[row][LOW][j] = tau[j] - spread;
        guard->rows[row][HIGH][j] = tau[j] + spread;
        guard->rows[row][SPEED][j] = sample->qd[j];
        guard->rows[row][TORQUE][j] = sample->tau[j];
    }
    guard->time = time;
    ++guard->ticks;
    for (int j = 0; j < 4; ++j) {
        if (driven[j] && judge(guard, j, time, sample) != SSM_GUARD_NONE) {
            return guard->cause;
        }
    }
    return SSM_GUARD_NONE;
}
