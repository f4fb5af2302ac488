/* FMI 3.0: types and functions with the names of the standard. */
#include <stdbool.h>
#include <stdint.h>

#if defined(FMI3_FUNCTION_PREFIX) && !defined(FMI3_OVERRIDE_FUNCTION_PREFIX)
#define FMI(function) EXPAND(FMI3_FUNCTION_PREFIX, function)
#else
#define FMI(function) function
#endif

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef bool fmi3Clock;
typedef Status fmi3Status;
typedef int fmi3DependencyKind;
typedef int fmi3IntervalQualifier;
typedef const fmi3ValueReference *References;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);

static void report(Instance *instance, Status status, const char *message) {
  const fmi3LogMessageCallback logger = (fmi3LogMessageCallback)instance->logger;
  if (logger) logger(instance->environment, status, "logStatusError", message);
}

EXPORT const char *FMI(fmi3GetVersion)(void) { return "3.0"; }

EXPORT fmi3Status FMI(fmi3SetDebugLogging)(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return STATUS_OK;
}

EXPORT fmi3Instance FMI(fmi3InstantiateModelExchange)(fmi3String instance_name, fmi3String token, fmi3String resources,
                                                      fmi3Boolean visible, fmi3Boolean logging,
                                                      fmi3InstanceEnvironment environment,
                                                      fmi3LogMessageCallback logger) {
  (void)resources, (void)visible, (void)logging;
  return OFFERS_MODEL_EXCHANGE ? create(instance_name, token, environment, (void (*)(void))logger) : NULL;
}

EXPORT fmi3Instance FMI(fmi3InstantiateCoSimulation)(
  fmi3String instance_name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
  fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t n,
  fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger, fmi3IntermediateUpdateCallback update) {
  (void)resources, (void)visible, (void)logging, (void)early_return, (void)intermediate, (void)n, (void)update;
  if (event_mode || !OFFERS_CO_SIMULATION) return NULL;
  return create(instance_name, token, environment, (void (*)(void))logger);
}

EXPORT void FMI(fmi3FreeInstance)(fmi3Instance c) { free(c); }

EXPORT fmi3Status FMI(fmi3EnterInitializationMode)(fmi3Instance c, fmi3Boolean tolerance_defined,
                                                   fmi3Float64 tolerance, fmi3Float64 start_time,
                                                   fmi3Boolean stop_defined, fmi3Float64 stop_time) {
  (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop_time;
  ((Instance *)c)->memory.value[TIME] = start_time;
  return STATUS_OK;
}

EXPORT fmi3Status FMI(fmi3ExitInitializationMode)(fmi3Instance c) {
  return leave_initialisation(c);
}

EXPORT fmi3Status FMI(fmi3Reset)(fmi3Instance c) {
  clear(&((Instance *)c)->memory, 0.0);
  return STATUS_OK;
}

MODE(fmi3EnterEventMode)
MODE(fmi3Terminate)
MODE(fmi3EnterConfigurationMode)
MODE(fmi3ExitConfigurationMode)
MODE(fmi3EvaluateDiscreteStates)
MODE(fmi3EnterContinuousTimeMode)
MODE(fmi3EnterStepMode)

EXPORT fmi3Status FMI(fmi3GetFloat64)(fmi3Instance c, References r, size_t n, fmi3Float64 value[], size_t values) {
  return n == values ? get_values(c, r, n, value) : complain(c, STATUS_ERROR, "every variable is a scalar", "");
}

EXPORT fmi3Status FMI(fmi3SetFloat64)(fmi3Instance c, References r, size_t n, const fmi3Float64 value[],
                                      size_t values) {
  return n == values ? set_values(c, r, n, value) : complain(c, STATUS_ERROR, "every variable is a scalar", "");
}

EXPORT fmi3Status FMI(fmi3GetFMUState)(fmi3Instance c, fmi3FMUState *kept) { return copy_state(c, kept); }
EXPORT fmi3Status FMI(fmi3SetFMUState)(fmi3Instance c, fmi3FMUState kept) { return restore_state(c, kept); }

EXPORT fmi3Status FMI(fmi3FreeFMUState)(fmi3Instance c, fmi3FMUState *kept) {
  (void)c;
  return forget_state(kept);
}

EXPORT fmi3Status FMI(fmi3SerializedFMUStateSize)(fmi3Instance c, fmi3FMUState kept, size_t *size) {
  (void)c, (void)kept;
  *size = sizeof(Memory);
  return STATUS_OK;
}

EXPORT fmi3Status FMI(fmi3SerializeFMUState)(fmi3Instance c, fmi3FMUState kept, fmi3Byte bytes[], size_t size) {
  return write_state(c, kept, bytes, size);
}

EXPORT fmi3Status FMI(fmi3DeserializeFMUState)(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                               fmi3FMUState *kept) {
  return read_state(c, bytes, size, kept);
}

EXPORT fmi3Status FMI(fmi3GetDirectionalDerivative)(fmi3Instance c, References unknown, size_t unknowns,
                                                    References known, size_t knowns, const fmi3Float64 seed[],
                                                    size_t n, fmi3Float64 sensitivity[], size_t m) {
#if HAS_DERIVATIVES
  if (n != knowns || m != unknowns) return complain(c, STATUS_ERROR, "every variable is a scalar", "");
  return directional(c, unknown, unknowns, known, knowns, seed, sensitivity);
#else
  (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)n, (void)sensitivity, (void)m;
  return complain(c, STATUS_ERROR, "there are no directional derivatives", "");
#endif
}

EXPORT fmi3Status FMI(fmi3UpdateDiscreteStates)(fmi3Instance c, fmi3Boolean *update, fmi3Boolean *terminate,
                                                fmi3Boolean *nominals, fmi3Boolean *values,
                                                fmi3Boolean *next_event, fmi3Float64 *next_event_time) {
  (void)c;
  *update = *terminate = *nominals = *values = *next_event = false;
  *next_event_time = 0.0;
  return STATUS_OK;
}

#if OFFERS_MODEL_EXCHANGE
EXPORT fmi3Status FMI(fmi3CompletedIntegratorStep)(fmi3Instance c, fmi3Boolean final, fmi3Boolean *enter_event_mode,
                                                   fmi3Boolean *terminate) {
  (void)c, (void)final;
  *enter_event_mode = *terminate = false;
  return STATUS_OK;
}

EXPORT fmi3Status FMI(fmi3SetTime)(fmi3Instance c, fmi3Float64 time) {
  ((Instance *)c)->memory.value[TIME] = time;
  return STATUS_OK;
}

EXPORT fmi3Status FMI(fmi3SetContinuousStates)(fmi3Instance c, const fmi3Float64 x[], size_t n) {
  return set_states(c, x, n);
}

EXPORT fmi3Status FMI(fmi3GetContinuousStateDerivatives)(fmi3Instance c, fmi3Float64 derivatives[], size_t n) {
  return get_vector(c, FIRST_DERIVATIVE, derivatives, n);
}

EXPORT fmi3Status FMI(fmi3GetContinuousStates)(fmi3Instance c, fmi3Float64 x[], size_t n) {
  return get_vector(c, FIRST_STATE, x, n);
}

EXPORT fmi3Status FMI(fmi3GetNominalsOfContinuousStates)(fmi3Instance c, fmi3Float64 nominals[], size_t n) {
  return get_nominals(c, nominals, n);
}

EXPORT fmi3Status FMI(fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t *n) {
  (void)c;
  *n = DERIVATIVES;
  return STATUS_OK;
}

EXPORT fmi3Status FMI(fmi3GetEventIndicators)(fmi3Instance c, fmi3Float64 indicators[], size_t n) {
  (void)c, (void)indicators;
  return n ? STATUS_ERROR : STATUS_OK;
}

EXPORT fmi3Status FMI(fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t *n) {
  (void)c;
  *n = 0;
  return STATUS_OK;
}
#endif

EXPORT fmi3Status FMI(fmi3DoStep)(fmi3Instance c, fmi3Float64 time, fmi3Float64 duration, fmi3Boolean final,
                                  fmi3Boolean *event_handling, fmi3Boolean *terminate, fmi3Boolean *early_return,
                                  fmi3Float64 *last_time) {
  (void)final;
  *event_handling = *terminate = *early_return = false;
#if OFFERS_CO_SIMULATION
  const Status status = advance(c, time, duration);
  *last_time = ((Instance *)c)->memory.value[TIME];
  return status;
#else
  *last_time = time;
  (void)duration;
  return complain(c, STATUS_ERROR, "there is no co-simulation", "");
#endif
}
