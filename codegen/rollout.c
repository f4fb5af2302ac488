/* Runs a sampled system for many samples. Comes after the definitions of
     derive_step(parameters, derived)
     step(state, exogenous, parameters, derived, next_state, row, margin)
   and of STATES, EXOGENOUS, PARAMETERS, STEP_DERIVED, COLUMNS; where HAS_SHORTCUT is 1 also of
     derive_shortcut(parameters, derived)
     shortcut(state, exogenous, parameters, derived, next_state, row, margin, valid)
   and of SHORTCUT_DERIVED: a cheaper step that gives the same numbers wherever valid > 0. */

#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { COMPLETED = 0, DIVERGED = 1, LEFT = 2 };

/* By bits: the optimiser may take floating-point comparisons for granted. An exponent of ones overflows. */
static inline int all_finite(const double *values, int count) {
  uint64_t overflows = 0;
  for (int i = 0; i < count; ++i) {
    uint64_t bits;
    memcpy(&bits, values + i, sizeof bits);
    overflows |= (bits & UINT64_C(0x7ff0000000000000)) + UINT64_C(0x0010000000000000);
  }
  return !(overflows >> 63);
}

/* Steps `state` on for `samples` samples, reading one line of `exogenous` a sample.
   Every `stride`-th sample writes a line of `rows`, the first one included; rows may be null.
   Ends early when the state is not finite (DIVERGED) or the margin is negative (LEFT).
   Returns the outcome; *done is the number of samples stepped. */
EXPORT int rollout(const double *parameters, const double *exogenous, double *state,
                   int64_t samples, int64_t stride, double *rows, int64_t *done) {
  double derived[STEP_DERIVED + 1], buffer[STATES], margin = 0;
  double *now = state, *next = buffer;
  int outcome = COMPLETED;
  int64_t k = 0, until_row = 0;
  derive_step(parameters, derived);
#if HAS_SHORTCUT
  double shortcut_derived[SHORTCUT_DERIVED + 1], valid = 0;
  derive_shortcut(parameters, shortcut_derived);
#endif
  while (k < samples && outcome == COMPLETED) {
    double *row = 0;
    if (rows && until_row == 0) {
      row = rows;
      rows += COLUMNS;
      until_row = stride;
    }
    --until_row;
#if HAS_SHORTCUT
    shortcut(now, exogenous, parameters, shortcut_derived, next, row, &margin, &valid);
    if (!(valid > 0))
#endif
      step(now, exogenous, parameters, derived, next, row, &margin);
    if (!all_finite(next, STATES)) outcome = DIVERGED;
    else if (margin < 0) outcome = LEFT;
    double *last = now;
    now = next;
    next = last;
    exogenous += EXOGENOUS;
    ++k;
  }
  if (now != state) memcpy(state, now, STATES * sizeof *state);
  *done = k;
  return outcome;
}
