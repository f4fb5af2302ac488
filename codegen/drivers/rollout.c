/* Runs a sampled system for many samples. Comes after driver.h, the sizes and the functions of codegen/sampled.py,
   with derive(parameters, derived) for expressions of the parameters alone. */

/* May change the state after a sample; none by default. */
#ifndef AFTER_SAMPLE
#define AFTER_SAMPLE(next)
#endif

/* Steps `state` by `samples` samples, reading one line of `exogenous` per sample.
   Every `stride`-th sample writes a line of `rows`, the first one included; rows may be null.
   Ends early when the state is not finite (DIVERGED) or the margin is negative (LEFT).
   Returns the outcome; *done is the number of samples stepped. */
EXPORT int rollout(const double *parameters, const double *exogenous, double *state,
                   int64_t samples, int64_t stride, double *rows, int64_t *done) {
  double derived[DERIVED + 1], hold[HOLD], buffer[STATES], moved[MOTION], margin = 0;
  double *now = state, *next = buffer;
  int outcome = COMPLETED;
  int64_t k = 0, until_row = 0;
#if HAS_ONE_STEP
  double valid = 0;
#endif
  derive(parameters, derived);
  while (k < samples && outcome == COMPLETED) {
    if (rows && until_row-- == 0) {
      observe(now, exogenous, parameters, derived, rows);
      rows += COLUMNS;
      until_row = stride - 1;
    }
#if HAS_FAST_SAMPLE
    if (now[PHASE] != 0) fast_sample(now, exogenous, parameters, derived, next + MOTION, hold);
    else
#endif
      sample(now, exogenous, parameters, derived, next + MOTION, hold);
    AFTER_SAMPLE(next);
#if HAS_ONE_STEP
    one_step(now, hold, parameters, derived, next, &margin, &valid);
    if (!(valid > 0))
#endif
    {
      const double *from = now;
      for (int part = 0; part < PARTS; ++part) {
        const double number = part;
        double *to = (PARTS - part) % 2 ? next : moved;
        move(from, hold, &number, parameters, derived, to, &margin);
        from = to;
      }
    }
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
