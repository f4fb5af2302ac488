/* Runs a sampled system for many samples and LANES sets of parameters at once, one in each vector lane.
   Comes after elementary.h and the definitions, over arrays whose elements lie LANES apart, of
     derive_step(parameters, derived)
     step(state, exogenous, parameters, derived, next_state, row, margin)
   and, where HAS_SHORTCUT is 1, of
     derive_shortcut(parameters, derived)
     shortcut(state, exogenous, parameters, derived, next_state, row, margin, valid)
   and of LANES, STATES, EXOGENOUS, PARAMETERS, STEP_DERIVED, SHORTCUT_DERIVED, COLUMNS.

   What a lane gives depends on its own numbers alone: lanes never mix. */

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { COMPLETED = 0, DIVERGED = 1, LEFT = 2 };

static __attribute__((noinline)) void derive_lanes(const double *restrict parameters, double *restrict derived
#if HAS_SHORTCUT
                                                   , double *restrict shortcut_derived
#endif
) {
  for (int l = 0; l < LANES; ++l) derive_step(parameters + l, derived + l);
#if HAS_SHORTCUT
  for (int l = 0; l < LANES; ++l) derive_shortcut(parameters + l, shortcut_derived + l);
#endif
}

static __attribute__((noinline)) void step_lanes(
    const double *restrict state, const double *restrict exogenous, const double *restrict parameters,
    const double *restrict derived, double *restrict next, double *restrict row, double *restrict margin) {
  for (int l = 0; l < LANES; ++l)
    step(state + l, exogenous + l, parameters + l, derived + l, next + l, row + l, margin + l);
}

#if HAS_SHORTCUT
static __attribute__((noinline)) void shortcut_lanes(
    const double *restrict state, const double *restrict exogenous, const double *restrict parameters,
    const double *restrict derived, double *restrict next, double *restrict row, double *restrict margin,
    double *restrict valid) {
  for (int l = 0; l < LANES; ++l)
    shortcut(state + l, exogenous + l, parameters + l, derived + l, next + l, row + l, margin + l, valid + l);
}

/* Takes the lanes over where the shortcut is not valid. */
static __attribute__((noinline)) void take_over(const double *restrict valid, double *restrict into, const double *restrict from, int count) {
  for (int i = 0; i < count; ++i)
    for (int l = 0; l < LANES; ++l) into[i * LANES + l] = valid[l] > 0 ? into[i * LANES + l] : from[i * LANES + l];
}
#endif

/* By bits: the optimiser may take floating-point comparisons for granted. An exponent of ones overflows. */
static __attribute__((noinline)) void find_finite(const double *restrict state, uint64_t *restrict finite) {
  uint64_t overflows[LANES] = {0};
  for (int i = 0; i < STATES; ++i)
    for (int l = 0; l < LANES; ++l)
      overflows[l] |= (to_bits(state[i * LANES + l]) & UINT64_C(0x7ff0000000000000)) + UINT64_C(0x0010000000000000);
  for (int l = 0; l < LANES; ++l) finite[l] = !(overflows[l] >> 63);
}

/* One block of LANES rollouts.
   parameters (LANES, PARAMETERS) and state (LANES, STATES) are rows; state is overwritten with the final states.
   exogenous[l] points to lane l's signals (samples, EXOGENOUS). Every stride-th sample writes a row of each lane to
   rows (LANES, kept, COLUMNS); rows may be null. outcome and done have LANES elements. */
EXPORT void batch(const double *parameters, const double *const *exogenous, double *state, int64_t samples,
                  int64_t stride, double *rows, int64_t kept, int64_t *outcome, int64_t *done) {
  double p[PARAMETERS * LANES], derived[(STEP_DERIVED + 1) * LANES], w[(EXOGENOUS + 1) * LANES];
  double first[STATES * LANES], second[STATES * LANES], row[COLUMNS * LANES], margin[LANES];
#if HAS_SHORTCUT
  double shortcut_derived[(SHORTCUT_DERIVED + 1) * LANES], careful[STATES * LANES], careful_row[COLUMNS * LANES];
  double careful_margin[LANES], valid[LANES];
#endif
  uint64_t finite[LANES];
  double *now = first, *next = second;
  int running = LANES, shared = 1;
  for (int l = 0; l < LANES; ++l) {
    for (int i = 0; i < PARAMETERS; ++i) p[i * LANES + l] = parameters[l * PARAMETERS + i];
    for (int i = 0; i < STATES; ++i) now[i * LANES + l] = state[l * STATES + i];
    outcome[l] = COMPLETED;
    done[l] = samples;
    shared = shared && exogenous[l] == exogenous[0];
  }
#if HAS_SHORTCUT
  derive_lanes(p, derived, shortcut_derived);
#else
  derive_lanes(p, derived);
#endif
  for (int64_t k = 0; k < samples && running > 0; ++k) {
    for (int i = 0; i < EXOGENOUS; ++i) {
      if (shared)
        for (int l = 0; l < LANES; ++l) w[i * LANES + l] = exogenous[0][k * EXOGENOUS + i];
      else
        for (int l = 0; l < LANES; ++l) w[i * LANES + l] = exogenous[l][k * EXOGENOUS + i];
    }
#if HAS_SHORTCUT
    shortcut_lanes(now, w, p, shortcut_derived, next, row, margin, valid);
    int missing = 0;
    for (int l = 0; l < LANES; ++l) missing += !(valid[l] > 0) && done[l] == samples;
    if (missing) {
      step_lanes(now, w, p, derived, careful, careful_row, careful_margin);
      take_over(valid, next, careful, STATES);
      take_over(valid, row, careful_row, COLUMNS);
      take_over(valid, margin, careful_margin, 1);
    }
#else
    step_lanes(now, w, p, derived, next, row, margin);
#endif
    if (rows && k % stride == 0)
      for (int l = 0; l < LANES; ++l)
        if (done[l] == samples)
          for (int i = 0; i < COLUMNS; ++i) rows[(l * kept + k / stride) * COLUMNS + i] = row[i * LANES + l];
    find_finite(next, finite);
    for (int l = 0; l < LANES; ++l) {
      if (done[l] < samples || (finite[l] && !(margin[l] < 0))) continue;
      outcome[l] = finite[l] ? LEFT : DIVERGED;
      done[l] = k + 1;
      --running;
      for (int i = 0; i < STATES; ++i) state[l * STATES + i] = next[i * LANES + l];
    }
    double *last = now;
    now = next;
    next = last;
  }
  for (int l = 0; l < LANES; ++l)
    if (outcome[l] == COMPLETED)
      for (int i = 0; i < STATES; ++i) state[l * STATES + i] = now[i * LANES + l];
}
