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

/* s */
extern const ssm_real ssm_duration;

/* Positions, velocities, accelerations and motor torques of the plan t seconds after its start. Before the start and from the
   end on a joint that rests there stands still and its motor is held; one that moves there is taken as at the start or end.
   tau_motor, by ssm_motor_torque, may be a null pointer. At an instant where the acceleration jumps it is what follows. */
void ssm_sample(ssm_real t, ssm_real q[4], ssm_real qd[4], ssm_real qdd[4], ssm_real tau_motor[4]);

#ifdef __cplusplus
}
#endif

#endif
