{{ comment }}
#include "{{ header }}"

enum { PIECES = {{ pieces | length }}, DEGREE = 5 };

const ssm_real ssm_duration = {{ breaks[-1] }};

/* Start of every piece and end of the motion, s. */
static const ssm_real breaks[PIECES + 1] = {
{% for row in breaks | batch(8) %}
    {{ row | join(", ") }},
{% endfor %}
};

/* Coefficients by piece, power of the time since its start, and joint. */
static const ssm_real coefficients[PIECES][DEGREE + 1][4] = {
{% for powers in pieces %}
    {
{% for row in powers %}
        { {{- row | join(", ") -}} },
{% endfor %}
    },
{% endfor %}
};

/* 1 if a joint moves at the start (first row) or at the end (second row). */
static const int moves[2][4] = {
{% for row in moves %}
    { {{- row | join(", ") -}} },
{% endfor %}
};

static int piece_at(ssm_real t)
{
    int low = 0, high = PIECES;
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (breaks[middle] <= t) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

void ssm_sample(ssm_real t, ssm_real q[4], ssm_real qd[4], ssm_real qdd[4], ssm_real tau_motor[4])
{
    const int before = !(t >= SSM_R(0.0)), after = t >= ssm_duration;
    const ssm_real clamped = before ? SSM_R(0.0) : (after ? ssm_duration : t);
    const int piece = piece_at(clamped);
    const ssm_real local = clamped - breaks[piece];
    ssm_real qddd[4];
    ssm_real *const derivatives[4] = {q, qd, qdd, qddd};
    for (int j = 0; j < 4; ++j) {
        ssm_real c[DEGREE + 1];
        for (int k = 0; k <= DEGREE; ++k) {
            c[k] = coefficients[piece][k][j];
        }
        for (int order = 0; order < 4; ++order) {
            ssm_real value = c[DEGREE - order];
            for (int k = DEGREE - order - 1; k >= 0; --k) {
                value = value * local + c[k];
            }
            derivatives[order][j] = value;
            for (int k = 0; k < DEGREE - order; ++k) {
                c[k] = c[k + 1] * (ssm_real)(k + 1);
            }
        }
        if ((before || after) && !moves[after][j]) {
            qd[j] = qdd[j] = qddd[j] = SSM_R(0.0);
        }
    }
    if (tau_motor) {
        ssm_motor_torque(q, qd, qdd, qddd, tau_motor);
    }
}
