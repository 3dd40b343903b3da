{{ comment }}
#ifndef SSM_GUARD_H
#define SSM_GUARD_H

#include "{{ robot }}"

#ifdef SSM_FLOAT32
#define ssm_guard_start ssm_guard_start_f32
#define ssm_guard_tick ssm_guard_tick_f32
#define ssm_guard ssm_guard_f32
#define ssm_guard_sample ssm_guard_sample_f32
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Number of ticks whose set points a drive may still execute. */
enum { SSM_GUARD_ROWS = {{ limits.rows }} };

/* Causes of an alarm. */
enum {
{% for cause in causes %}
    SSM_GUARD_{{ cause.name }} = {{ cause.value }}{{ "" if loop.last else "," }}
{% endfor %}
};

/* Measurements of the joints, with the signs of the joints. */
typedef struct {
    ssm_real time[4]; /* instant of each measurement, s; an old one if no new one arrived */
    ssm_real q[4];    /* positions */
    ssm_real qd[4];   /* velocities */
    ssm_real tau[4];  /* motor torques */
} ssm_guard_sample;

/* State of the guard. */
typedef struct {
    int cause;      /* SSM_GUARD_NONE, or the cause of the first alarm */
    int joint;      /* joint of the alarm, or -1 */
    ssm_real value; /* value that exceeds its bound */
    ssm_real bound;
    ssm_real time; /* instant of the last tick */
    unsigned long ticks;
    ssm_real rows[SSM_GUARD_ROWS][6][4];
} ssm_guard;

/* Prepares the guard for the first tick. */
void ssm_guard_start(ssm_guard *guard);

/* Judges one tick. `time` is the present instant, and q, qd, qdd are the set points, for example
   from ssm_sample. The result is SSM_GUARD_NONE, or the cause of the first alarm since the start.
   After an alarm, begin a controlled stop. */
int ssm_guard_tick(ssm_guard *guard, ssm_real time, const ssm_real q[4], const ssm_real qd[4],
                   const ssm_real qdd[4], const ssm_guard_sample *sample);

#ifdef __cplusplus
}
#endif

#endif
