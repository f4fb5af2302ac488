/* Runs a sampled system for many samples. Comes after driver.h, the sizes and the functions of codegen/sampled.py,
   each with its derive_NAME(parameters, derived) for expressions of the parameters alone. */

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
  double for_sample[SAMPLE_DERIVED + 1], for_observe[OBSERVE_DERIVED + 1], for_move[MOVE_DERIVED + 1];
  double hold[HOLD], buffer[STATES], moved[MOTION], margin = 0;
  double *now = state, *next = buffer;
  int outcome = COMPLETED;
  int64_t k = 0, until_row = 0;
  derive_sample(parameters, for_sample);
#if HAS_FAST_SAMPLE
  double for_fast_sample[FAST_SAMPLE_DERIVED + 1];
  derive_fast_sample(parameters, for_fast_sample);
#endif
  derive_observe(parameters, for_observe);
  derive_move(parameters, for_move);
#if HAS_ONE_STEP
  double for_one_step[ONE_STEP_DERIVED + 1], valid = 0;
  derive_one_step(parameters, for_one_step);
#endif
  while (k < samples && outcome == COMPLETED) {
    if (rows && until_row-- == 0) {
      observe(now, exogenous, parameters, for_observe, rows);
      rows += COLUMNS;
      until_row = stride - 1;
    }
#if HAS_FAST_SAMPLE
    if (now[PHASE] != 0) fast_sample(now, exogenous, parameters, for_fast_sample, next + MOTION, hold);
    else
#endif
      sample(now, exogenous, parameters, for_sample, next + MOTION, hold);
    AFTER_SAMPLE(next);
#if HAS_ONE_STEP
    one_step(now, hold, parameters, for_one_step, next, &margin, &valid);
    if (!(valid > 0))
#endif
    {
      const double *from = now;
      for (int part = 0; part < PARTS; ++part) {
        const double number = part;
        double *to = (PARTS - part) % 2 ? next : moved;
        move(from, hold, &number, parameters, for_move, to, &margin);
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
