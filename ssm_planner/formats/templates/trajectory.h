{{ comment }}
#ifndef SSM_TRAJECTORY_H
#define SSM_TRAJECTORY_H

#include "{{ robot }}"

#ifdef SSM_FLOAT32
#define ssm_sample ssm_sample_f32
#define ssm_duration ssm_duration_f32
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Duration, s. */
extern const ssm_real ssm_duration;

/* Computes positions, velocities, accelerations and motor torques of the plan t seconds after its start.
   Before the start and after the end, a joint that rests there stands still and its motor is held.
   A joint that moves there keeps its state at the start or the end. At an acceleration jump the result
   is the value after the jump. tau_motor (see ssm_motor_torque) may be a null pointer. */
void ssm_sample(ssm_real t, ssm_real q[4], ssm_real qd[4], ssm_real qdd[4], ssm_real tau_motor[4]);

#ifdef __cplusplus
}
#endif

#endif
