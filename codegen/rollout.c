/* Runs a sampled system for many samples. Comes after the definitions of
     derive(parameters, derived)
     step(state, exogenous, parameters, derived, next_state, row, margin)
   and of STATES, EXOGENOUS, PARAMETERS, DERIVED, COLUMNS. */

#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { COMPLETED = 0, DIVERGED = 1, LEFT = 2 };

/* By bits: the optimiser may take floating-point comparisons for granted. */
static inline int all_finite(const double *values, int count) {
  uint64_t worst = 0;
  for (int i = 0; i < count; ++i) {
    uint64_t bits;
    memcpy(&bits, values + i, sizeof bits);
    bits &= UINT64_C(0x7ff0000000000000);
    worst = bits > worst ? bits : worst;
  }
  return worst < UINT64_C(0x7ff0000000000000);
}

/* Steps `state` on for `samples` samples, reading one line of `exogenous` a sample.
   Every `stride`-th sample writes a line of `rows`, the first one included; rows may be null.
   Ends early when the state is not finite (DIVERGED) or the margin is negative (LEFT).
   Returns the outcome; *done is the number of samples stepped. */
EXPORT int rollout(const double *parameters, const double *exogenous, double *state,
                   int64_t samples, int64_t stride, double *rows, int64_t *done) {
  double derived[DERIVED + 1], buffer[STATES], margin = 0;
  double *now = state, *next = buffer;
  int outcome = COMPLETED;
  int64_t k = 0, until_row = 0;
  derive(parameters, derived);
  while (k < samples && outcome == COMPLETED) {
    double *row = 0;
    if (rows && until_row == 0) {
      row = rows;
      rows += COLUMNS;
      until_row = stride;
    }
    --until_row;
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
