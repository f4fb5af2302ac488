#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* A name with the prefix of its version of FMI. */
#define PASTE(prefix, function) prefix##function
#define EXPAND(prefix, function) PASTE(prefix, function)

/* A change of mode, which needs no action. */
#define MODE(function)                   \
  EXPORT Status FMI(function)(void *c) { \
    (void)c;                             \
    return STATUS_OK;                    \
  }

/* The statuses of FMI 2 and FMI 3 have the same numbers. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL } Status;

/* All variable data: a copy of it is a state of the FMU. Values are indexed by value reference. */
typedef struct {
  char token[sizeof TOKEN];
  int initialising; /* the state follows from the parameters */
  int stepped;      /* outputs with direct feedthrough are those of the last sample */
  int stale;        /* derivatives and outputs must be recomputed */
  int unprepared;   /* values derived from the parameters alone must be recomputed */
  double value[VARIABLES];
  double derived[DERIVED + 1];
} Memory;

typedef struct Instance {
  Memory memory;
  void (*logger)(void);
  void *environment;
  char name[128];
} Instance;

static void report(Instance *instance, Status status, const char *message);

static void clear(Memory *memory, double time) {
  memset(memory, 0, sizeof *memory);
  memcpy(memory->token, TOKEN, sizeof TOKEN);
  memory->initialising = memory->stale = memory->unprepared = 1;
  memcpy(memory->value, start_value, sizeof start_value);
  memory->value[TIME] = time;
}

static Instance *create(const char *instance_name, const char *token, void *environment, void (*logger)(void)) {
  Instance *instance = calloc(1, sizeof *instance);
  if (!instance) return NULL;
  instance->logger = logger;
  instance->environment = environment;
  if (instance_name) snprintf(instance->name, sizeof instance->name, "%s", instance_name);
  if (!token || strcmp(token, TOKEN) != 0) {
    report(instance, STATUS_ERROR, "the token is not that of this FMU's model description");
    free(instance);
    return NULL;
  }
  clear(&instance->memory, 0.0);
  return instance;
}

/* Update the values derived from the parameters alone: once after changes of parameters, not at every sample. */
static void prepare(Memory *memory) {
  if (memory->unprepared) derive(memory->value + FIRST_PARAMETER, memory->derived);
  memory->unprepared = 0;
}

/* Update all values that depend on others. */
static void settle(Memory *memory) {
  double *value = memory->value, output[OUTPUTS + 1];
  if (!memory->stale) return;
  prepare(memory);
  if (memory->initialising) start(value + FIRST_PARAMETER, memory->derived, value + FIRST_STATE);
  now(value + FIRST_STATE, value + FIRST_INPUT, value + FIRST_PARAMETER, memory->derived, value + FIRST_DERIVATIVE,
      output);
  for (int i = 0; i < OUTPUTS; i++)
    if (!memory->stepped || !held[i]) value[FIRST_OUTPUT + i] = output[i];
  memory->stale = 0;
}

static Status complain(Instance *instance, Status status, const char *what, const char *of) {
  char message[256];
  snprintf(message, sizeof message, "%s%s", of, what);
  report(instance, status, message);
  return status;
}

static Status set_values(Instance *instance, const unsigned int reference[], size_t count, const double given[]) {
  for (size_t i = 0; i < count; i++) {
    const int is_state = reference[i] >= FIRST_STATE && reference[i] < FIRST_DERIVATIVE;
    if (reference[i] >= FIRST_OUTPUT && (!is_state || instance->memory.initialising))
      return complain(instance, STATUS_ERROR, "only inputs, parameters and, later, states can be set", "");
    if (!isfinite(given[i]) || given[i] < lower[reference[i]] || given[i] > upper[reference[i]])
      return complain(instance, STATUS_DISCARD, ": the value is out of range", name[reference[i]]);
  }
  for (size_t i = 0; i < count; i++) {
    instance->memory.value[reference[i]] = given[i];
    if (reference[i] >= FIRST_PARAMETER && reference[i] < FIRST_OUTPUT) instance->memory.unprepared = 1;
  }
  if (count) instance->memory.stale = 1;
  return STATUS_OK;
}

/* Requirements on parameters beyond the range of each: whole numbers, and relations between several. */
static Status check_rules(Instance *instance) {
#if RULES
  double holds[RULES];
  rules(instance->memory.value + FIRST_PARAMETER, holds);
  for (int i = 0; i < RULES; i++)
    if (!(holds[i] > 0))
      return complain(instance, STATUS_ERROR, " contradicts another parameter, or must be whole or odd", name[ruled[i]]);
#else
  (void)instance;
#endif
  return STATUS_OK;
}

static Status get_values(Instance *instance, const unsigned int reference[], size_t count, double wanted[]) {
  settle(&instance->memory);
  for (size_t i = 0; i < count; i++) {
    if (reference[i] >= VARIABLES) return complain(instance, STATUS_ERROR, "no such value reference", "");
    wanted[i] = instance->memory.value[reference[i]];
    if (!isfinite(wanted[i])) return complain(instance, STATUS_DISCARD, " is not finite", name[reference[i]]);
  }
  return STATUS_OK;
}

static Status leave_initialisation(Instance *instance) {
  const Status status = check_rules(instance);
  if (status != STATUS_OK) return status;
  settle(&instance->memory);
  instance->memory.initialising = 0;
  return STATUS_OK;
}

#if OFFERS_CO_SIMULATION
/* Run the samples of a communication step; a refused step changes nothing. One that is no multiple of the sample time is
   an error, not discarded: masters repeat a discarded step. */
static Status advance(Instance *instance, double time, double duration) {
  Memory next = instance->memory;
  double *value = next.value, following[STATES + 1], *state = value + FIRST_STATE;
  const double samples = floor(duration / SAMPLE_TIME + 0.5);
  if (!(samples >= 1 && samples <= 1e9) || fabs(duration - samples * SAMPLE_TIME) > 1e-6 * SAMPLE_TIME) {
    char what[128];
    snprintf(what, sizeof what, "the communication step of %.9g s is no multiple of the sample time, %.9g s", duration,
             (double)SAMPLE_TIME);
    return complain(instance, STATUS_ERROR, what, "");
  }
  if (next.unprepared && check_rules(instance) != STATUS_OK) return STATUS_ERROR;
  prepare(&next);
  for (double sample = 1; sample <= samples; sample++) {
    if (HAS_HELD && sample == samples) {
      next.stepped = 0;
      next.stale = 1;
      settle(&next);
    }
    step(state, value + FIRST_INPUT, value + FIRST_PARAMETER, next.derived, following);
    memcpy(state, following, STATES * sizeof *state);
    for (int i = 0; i < STATES; i++)
      if (!isfinite(state[i])) return complain(instance, STATUS_ERROR, " is not finite", name[FIRST_STATE + i]);
  }
  next.stepped = next.stale = 1;
  value[TIME] = time + duration;
  instance->memory = next;
  return STATUS_OK;
}
#endif

static Status copy_state(const Instance *instance, void **kept) {
  if (!*kept) *kept = malloc(sizeof(Memory));
  if (!*kept) return STATUS_ERROR;
  memcpy(*kept, &instance->memory, sizeof(Memory));
  return STATUS_OK;
}

static Status restore_state(Instance *instance, const void *kept) {
  if (!kept) return complain(instance, STATUS_ERROR, "there is no state to restore", "");
  memcpy(&instance->memory, kept, sizeof(Memory));
  return STATUS_OK;
}

static Status forget_state(void **kept) {
  if (kept) {
    free(*kept);
    *kept = NULL;
  }
  return STATUS_OK;
}

static Status write_state(Instance *instance, const void *kept, void *bytes, size_t size) {
  if (!kept || size < sizeof(Memory)) return complain(instance, STATUS_ERROR, "too little room for the state", "");
  memcpy(bytes, kept, sizeof(Memory));
  return STATUS_OK;
}

static Status read_state(Instance *instance, const void *bytes, size_t size, void **kept) {
  if (size != sizeof(Memory) || memcmp(bytes, TOKEN, sizeof TOKEN) != 0)
    return complain(instance, STATUS_ERROR, "these bytes are no state of this FMU", "");
  *kept = malloc(sizeof(Memory));
  if (!*kept) return STATUS_ERROR;
  memcpy(*kept, bytes, sizeof(Memory));
  return STATUS_OK;
}

#if HAS_DERIVATIVES
/* Exact directional derivative of states (before the end of initialisation), derivatives and outputs. */
static Status directional(Instance *instance, const unsigned int unknown[], size_t unknowns,
                          const unsigned int known[], size_t knowns, const double seeds[], double wanted[]) {
  double seed[VARIABLES] = {0};
  const double *value = instance->memory.value;
  settle(&instance->memory);
  for (size_t i = 0; i < knowns; i++) {
    if (known[i] >= FIRST_DERIVATIVE || (known[i] >= FIRST_OUTPUT && known[i] < FIRST_STATE))
      return complain(instance, STATUS_ERROR, "derivatives are by inputs, parameters and states", "");
    seed[known[i]] = seeds[i];
  }
  if (instance->memory.initialising)
    start_tangent(value + FIRST_PARAMETER, seed + FIRST_PARAMETER, seed + FIRST_STATE);
  now_tangent(value + FIRST_STATE, value + FIRST_INPUT, value + FIRST_PARAMETER, seed + FIRST_STATE,
        seed + FIRST_INPUT, seed + FIRST_PARAMETER, seed + FIRST_DERIVATIVE, seed + FIRST_OUTPUT);
  for (size_t i = 0; i < unknowns; i++) {
    if (unknown[i] < FIRST_OUTPUT || unknown[i] >= TIME)
      return complain(instance, STATUS_ERROR, "derivatives are of outputs, states and their derivatives", "");
    wanted[i] = seed[unknown[i]];
  }
  return STATUS_OK;
}
#endif

#if OFFERS_MODEL_EXCHANGE
static Status set_states(Instance *instance, const double state[], size_t count) {
  if (count != DERIVATIVES) return complain(instance, STATUS_ERROR, "wrong number of continuous states", "");
  for (size_t i = 0; i < DERIVATIVES; i++)
    if (!isfinite(state[i])) return complain(instance, STATUS_DISCARD, " is not finite", name[FIRST_STATE + i]);
  memcpy(instance->memory.value + FIRST_STATE, state, DERIVATIVES * sizeof *state);
  instance->memory.stale = 1;
  return STATUS_OK;
}

static Status get_nominals(Instance *instance, double nominals[], size_t count) {
  if (count != DERIVATIVES) return complain(instance, STATUS_ERROR, "wrong number of continuous states", "");
  memcpy(nominals, nominal, DERIVATIVES * sizeof *nominals);
  return STATUS_OK;
}

static Status get_vector(Instance *instance, unsigned int first, double wanted[], size_t count) {
  if (count != DERIVATIVES) return complain(instance, STATUS_ERROR, "wrong number of continuous states", "");
  settle(&instance->memory);
  memcpy(wanted, instance->memory.value + first, DERIVATIVES * sizeof *wanted);
  return STATUS_OK;
}
#endif
