/* FMI 2.0: types and functions with the names of the standard. */
#if defined(FMI2_FUNCTION_PREFIX) && !defined(FMI2_OVERRIDE_FUNCTION_PREFIX)
#define FMI(function) EXPAND(FMI2_FUNCTION_PREFIX, function)
#else
#define FMI(function) function
#endif

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef Status fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);

typedef struct {
  fmi2CallbackLogger logger;
  void *(*allocateMemory)(size_t, size_t);
  void (*freeMemory)(void *);
  void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
  fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
  fmi2Boolean newDiscreteStatesNeeded;
  fmi2Boolean terminateSimulation;
  fmi2Boolean nominalsOfContinuousStatesChanged;
  fmi2Boolean valuesOfContinuousStatesChanged;
  fmi2Boolean nextEventTimeDefined;
  fmi2Real nextEventTime;
} fmi2EventInfo;

static void report(Instance *instance, Status status, const char *message) {
  const fmi2CallbackLogger logger = (fmi2CallbackLogger)instance->logger;
  if (logger) logger(instance->environment, instance->name, status, "logStatusError", "%s", message);
}

EXPORT const char *FMI(fmi2GetTypesPlatform)(void) { return "default"; }
EXPORT const char *FMI(fmi2GetVersion)(void) { return "2.0"; }

EXPORT fmi2Status FMI(fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return STATUS_OK;
}

EXPORT fmi2Component FMI(fmi2Instantiate)(fmi2String instance_name, fmi2Type type, fmi2String token,
                                          fmi2String resources, const fmi2CallbackFunctions *functions,
                                          fmi2Boolean visible, fmi2Boolean logging) {
  (void)resources, (void)visible, (void)logging;
  if (type == fmi2ModelExchange ? !OFFERS_MODEL_EXCHANGE : !OFFERS_CO_SIMULATION) return NULL;
  return create(instance_name, token, functions ? functions->componentEnvironment : NULL,
                  functions ? (void (*)(void))functions->logger : NULL);
}

EXPORT void FMI(fmi2FreeInstance)(fmi2Component c) { free(c); }

EXPORT fmi2Status FMI(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                                           fmi2Real start_time, fmi2Boolean stop_defined, fmi2Real stop_time) {
  (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop_time;
  ((Instance *)c)->memory.value[TIME] = start_time;
  return STATUS_OK;
}

MODE(fmi2EnterInitializationMode)

EXPORT fmi2Status FMI(fmi2ExitInitializationMode)(fmi2Component c) {
  return leave_initialisation(c);
}

MODE(fmi2Terminate)

EXPORT fmi2Status FMI(fmi2Reset)(fmi2Component c) {
  clear(&((Instance *)c)->memory, 0.0);
  return STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2GetReal)(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real value[]) {
  return get_values(c, r, n, value);
}

EXPORT fmi2Status FMI(fmi2SetReal)(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real value[]) {
  return set_values(c, r, n, value);
}

/* All variables are reals. */
#define NONE_OF(type)                                                                                                \
  EXPORT fmi2Status FMI(fmi2Get##type)(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##type v[]) {    \
    (void)r, (void)v;                                                                                                \
    return n ? complain(c, STATUS_ERROR, "there are no variables of this type", "") : STATUS_OK;                     \
  }                                                                                                                  \
  EXPORT fmi2Status FMI(fmi2Set##type)(fmi2Component c, const fmi2ValueReference r[], size_t n,                      \
                                       const fmi2##type v[]) {                                                       \
    (void)r, (void)v;                                                                                                \
    return n ? complain(c, STATUS_ERROR, "there are no variables of this type", "") : STATUS_OK;                     \
  }
NONE_OF(Integer)
NONE_OF(Boolean)
NONE_OF(String)

EXPORT fmi2Status FMI(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *kept) { return copy_state(c, kept); }
EXPORT fmi2Status FMI(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate kept) { return restore_state(c, kept); }

EXPORT fmi2Status FMI(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *kept) {
  (void)c;
  return forget_state(kept);
}

EXPORT fmi2Status FMI(fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate kept, size_t *size) {
  (void)c, (void)kept;
  *size = sizeof(Memory);
  return STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate kept, fmi2Byte bytes[], size_t size) {
  return write_state(c, kept, bytes, size);
}

EXPORT fmi2Status FMI(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                               fmi2FMUstate *kept) {
  return read_state(c, bytes, size, kept);
}

EXPORT fmi2Status FMI(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknown[],
                                                    size_t unknowns, const fmi2ValueReference known[], size_t knowns,
                                                    const fmi2Real seed[], fmi2Real sensitivity[]) {
#if HAS_DERIVATIVES
  return directional(c, unknown, unknowns, known, knowns, seed, sensitivity);
#else
  (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)sensitivity;
  return complain(c, STATUS_ERROR, "there are no directional derivatives", "");
#endif
}

#if OFFERS_MODEL_EXCHANGE
MODE(fmi2EnterEventMode)

EXPORT fmi2Status FMI(fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info) {
  (void)c;
  memset(info, 0, sizeof *info);
  return STATUS_OK;
}

MODE(fmi2EnterContinuousTimeMode)

EXPORT fmi2Status FMI(fmi2CompletedIntegratorStep)(fmi2Component c, fmi2Boolean final, fmi2Boolean *enter_event_mode,
                                                   fmi2Boolean *terminate) {
  (void)c, (void)final;
  *enter_event_mode = *terminate = 0;
  return STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2SetTime)(fmi2Component c, fmi2Real time) {
  ((Instance *)c)->memory.value[TIME] = time;
  return STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2SetContinuousStates)(fmi2Component c, const fmi2Real x[], size_t n) {
  return set_states(c, x, n);
}

EXPORT fmi2Status FMI(fmi2GetDerivatives)(fmi2Component c, fmi2Real derivatives[], size_t n) {
  return get_vector(c, FIRST_DERIVATIVE, derivatives, n);
}

EXPORT fmi2Status FMI(fmi2GetEventIndicators)(fmi2Component c, fmi2Real indicators[], size_t n) {
  (void)c, (void)indicators;
  return n ? STATUS_ERROR : STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2GetContinuousStates)(fmi2Component c, fmi2Real x[], size_t n) {
  return get_vector(c, FIRST_STATE, x, n);
}

EXPORT fmi2Status FMI(fmi2GetNominalsOfContinuousStates)(fmi2Component c, fmi2Real nominals[], size_t n) {
  return get_nominals(c, nominals, n);
}
#endif

#if OFFERS_CO_SIMULATION
EXPORT fmi2Status FMI(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                                   const fmi2Integer order[], const fmi2Real value[]) {
  (void)r, (void)order, (void)value;
  return n ? complain(c, STATUS_ERROR, "inputs are held over a sample", "") : STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                                    const fmi2Integer order[], fmi2Real value[]) {
  (void)r, (void)order, (void)value;
  return n ? complain(c, STATUS_ERROR, "there are no output derivatives", "") : STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2DoStep)(fmi2Component c, fmi2Real time, fmi2Real duration, fmi2Boolean final) {
  (void)final;
  return advance(c, time, duration);
}

EXPORT fmi2Status FMI(fmi2CancelStep)(fmi2Component c) {
  return complain(c, STATUS_ERROR, "no step is under way", "");
}

EXPORT fmi2Status FMI(fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
  (void)c, (void)kind, (void)value;
  return STATUS_DISCARD;
}

EXPORT fmi2Status FMI(fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
  if (kind != fmi2LastSuccessfulTime) return STATUS_DISCARD;
  *value = ((Instance *)c)->memory.value[TIME];
  return STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
  (void)c, (void)kind, (void)value;
  return STATUS_DISCARD;
}

EXPORT fmi2Status FMI(fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
  (void)c;
  if (kind != fmi2Terminated) return STATUS_DISCARD;
  *value = 0;
  return STATUS_OK;
}

EXPORT fmi2Status FMI(fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
  (void)c, (void)kind, (void)value;
  return STATUS_DISCARD;
}
#endif
