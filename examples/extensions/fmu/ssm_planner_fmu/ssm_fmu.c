/*
 * FMI 3.0 interface of the C export, for co-simulation.
 *
 * The unit has no states. `plan.*` are functions of time, and the other outputs are functions of
 * the inputs. Value references: 0 time, 1 to 4 the inputs q, qd, qdd and qddd, 5 to 8 the plan,
 * 9 the rigid-body effort, 10 the motor torque. All variables but the time have four values.
 */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "ssm_unit.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef uint32_t reference;

enum { TIME, Q, QD, QDD, QDDD, PLAN, EFFORT = PLAN + 4, TORQUE, VARIABLES };

typedef struct {
    double time;
    double input[4][4];
} unit;

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
    bool visible, bool logging, bool event_mode, bool early_return, const reference required[],
    size_t count, void *environment, void *log, void *update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)event_mode, (void)required;
    (void)early_return, (void)count, (void)environment, (void)log, (void)update;
    return strcmp(token, SSM_TOKEN) == 0 ? calloc(1, sizeof(unit)) : NULL;
}

EXPORT void fmi3FreeInstance(void *instance) { free(instance); }

EXPORT fmi3Status fmi3EnterInitializationMode(void *instance, bool has_tolerance, double tolerance,
    double start, bool has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((unit *)instance)->time = start;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(void *instance)
{
    memset(instance, 0, sizeof(unit));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(void *instance, double time, double step, bool keeps_state,
    bool *event, bool *terminate, bool *returns_early, double *last)
{
    (void)keeps_state;
    ((unit *)instance)->time = *last = time + step;
    *event = *terminate = *returns_early = false;
    return fmi3OK;
}

/* Computes the values of a variable. Returns 0 for an unknown reference. */
static int evaluate(const unit *u, reference variable, double *value)
{
    double plan[4][4];
    if (variable == TIME) {
        *value = u->time;
    } else if (variable < PLAN) {
        memcpy(value, u->input[variable - Q], sizeof u->input[0]);
    } else if (variable < EFFORT) {
        ssm_sample(u->time, plan[0], plan[1], plan[2], plan[3]);
        memcpy(value, plan[variable - PLAN], sizeof plan[0]);
    } else if (variable == EFFORT) {
        ssm_inverse_dynamics(u->input[0], u->input[1], u->input[2], value);
    } else if (variable == TORQUE) {
        ssm_motor_torque(u->input[0], u->input[1], u->input[2], u->input[3], value);
    }
    return variable < VARIABLES;
}

EXPORT fmi3Status fmi3GetFloat64(
    void *instance, const reference variables[], size_t count, double values[], size_t length)
{
    double *const end = values + length;
    for (size_t k = 0; k < count; ++k) {
        const int size = variables[k] == TIME ? 1 : 4;
        if (end - values < size || !evaluate(instance, variables[k], values)) {
            return fmi3Error;
        }
        values += size;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(
    void *instance, const reference variables[], size_t count, const double values[], size_t length)
{
    for (size_t k = 0; k < count; ++k) {
        if (variables[k] < Q || variables[k] >= PLAN || length < 4 * (k + 1)) {
            return fmi3Error;
        }
        memcpy(((unit *)instance)->input[variables[k] - Q], values + 4 * k, 4 * sizeof(double));
    }
    return fmi3OK;
}

#define SUCCEEDS(name) EXPORT fmi3Status name(void *instance) { (void)instance; return fmi3OK; }
SUCCEEDS(fmi3ExitInitializationMode)
SUCCEEDS(fmi3Terminate)

EXPORT fmi3Status fmi3SetDebugLogging(
    void *instance, bool on, size_t count, const char *const names[])
{
    (void)instance, (void)on, (void)count, (void)names;
    return fmi3OK;
}

/* FMI requires that all its functions exist. The unit supports none of the following, so they
   ignore their arguments. */
#define FAILS(name) EXPORT fmi3Status name(void) { return fmi3Error; }
#define NONE(name) EXPORT void *name(void) { return NULL; }
NONE(fmi3InstantiateModelExchange) NONE(fmi3InstantiateScheduledExecution)
FAILS(fmi3EnterEventMode) FAILS(fmi3GetFloat32) FAILS(fmi3GetInt8) FAILS(fmi3GetUInt8)
FAILS(fmi3GetInt16) FAILS(fmi3GetUInt16) FAILS(fmi3GetInt32) FAILS(fmi3GetUInt32)
FAILS(fmi3GetInt64) FAILS(fmi3GetUInt64) FAILS(fmi3GetBoolean) FAILS(fmi3GetString)
FAILS(fmi3GetBinary) FAILS(fmi3GetClock) FAILS(fmi3SetFloat32) FAILS(fmi3SetInt8)
FAILS(fmi3SetUInt8) FAILS(fmi3SetInt16) FAILS(fmi3SetUInt16) FAILS(fmi3SetInt32)
FAILS(fmi3SetUInt32) FAILS(fmi3SetInt64) FAILS(fmi3SetUInt64) FAILS(fmi3SetBoolean)
FAILS(fmi3SetString) FAILS(fmi3SetBinary) FAILS(fmi3SetClock)
FAILS(fmi3GetNumberOfVariableDependencies) FAILS(fmi3GetVariableDependencies)
FAILS(fmi3GetFMUState) FAILS(fmi3SetFMUState) FAILS(fmi3FreeFMUState)
FAILS(fmi3SerializedFMUStateSize) FAILS(fmi3SerializeFMUState) FAILS(fmi3DeserializeFMUState)
FAILS(fmi3GetDirectionalDerivative) FAILS(fmi3GetAdjointDerivative)
FAILS(fmi3EnterConfigurationMode) FAILS(fmi3ExitConfigurationMode) FAILS(fmi3GetIntervalDecimal)
FAILS(fmi3GetIntervalFraction) FAILS(fmi3GetShiftDecimal) FAILS(fmi3GetShiftFraction)
FAILS(fmi3SetIntervalDecimal) FAILS(fmi3SetIntervalFraction) FAILS(fmi3SetShiftDecimal)
FAILS(fmi3SetShiftFraction) FAILS(fmi3EvaluateDiscreteStates) FAILS(fmi3UpdateDiscreteStates)
FAILS(fmi3EnterContinuousTimeMode) FAILS(fmi3CompletedIntegratorStep) FAILS(fmi3SetTime)
FAILS(fmi3SetContinuousStates) FAILS(fmi3GetContinuousStateDerivatives)
FAILS(fmi3GetEventIndicators) FAILS(fmi3GetContinuousStates)
FAILS(fmi3GetNominalsOfContinuousStates) FAILS(fmi3GetNumberOfEventIndicators)
FAILS(fmi3GetNumberOfContinuousStates) FAILS(fmi3EnterStepMode) FAILS(fmi3GetOutputDerivatives)
FAILS(fmi3ActivateModelPartition)
