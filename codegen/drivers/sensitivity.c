/* Runs a sampled system with the sensitivities of its state to some directions in its parameters.
   LANES samples are stepped, then their slopes computed side by side, a sample in each lane, then the tangents taken
   through these samples one after the other, a direction in each lane.
   Comes after driver.h, elementary.h, the sizes and the functions of codegen/drivers/sensitivity.py: those of
   codegen/sampled.py, each with its derive_NAME(parameters, derived), and over arrays whose elements lie LANES apart
     sample_slopes(state, exogenous, parameters, derived, slopes)
     one_step_slopes(motion, hold, parameters, derived, slopes)
   and with tangents whose elements lie DIRECTIONS apart
     along_move(motion, hold, part, parameters, motion_tangent, hold_tangent, next_motion_tangent).
   SAMPLE_PRODUCT and ONE_STEP_PRODUCT are the statements of codegen/drivers/tangents.py for one lane: tangents of the
   outputs from slopes and tangents of the inputs. */

/* LANES samples of the run: what their slopes depend on. Element i of sample t is at [i * LANES + t]. */
typedef struct {
  LANE_ARRAY state[STATES * LANES], exogenous[(EXOGENOUS + 1) * LANES], hold[HOLD * LANES];
  LANE_ARRAY sample_slopes[(SAMPLE_SLOPES + 1) * LANES];
#if HAS_ONE_STEP
  LANE_ARRAY one_step_slopes[(ONE_STEP_SLOPES + 1) * LANES];
#endif
  int in_one_step[LANES]; /* whether the one-step update was valid */
} Stretch;

static inline void put(double *to, const double *values, int count) {
  for (int i = 0; i < count; ++i) to[i * LANES] = values[i];
}

static inline void take(double *values, const double *from, int count) {
  for (int i = 0; i < count; ++i) values[i] = from[i * LANES];
}

IN_LANES sample_slopes_lanes(const double *restrict state, const double *restrict exogenous, const double *restrict p,
                             const double *restrict derived, double *restrict slopes) {
  EACH_CALL sample_slopes(state + l, exogenous + l, p, derived, slopes + l);
}

IN_LANES sample_product(const double *restrict slopes, const double *restrict states, const double *restrict directions,
                       double *restrict discretes, double *restrict holds) {
  EACH_OF(DIRECTIONS) {
    const double *restrict state_tangent = states + l, *restrict direction = directions + l;
    double *restrict discrete_tangent = discretes + l, *restrict hold_tangent = holds + l;
    SAMPLE_PRODUCT
  }
}

#if HAS_ONE_STEP
IN_LANES one_step_slopes_lanes(const double *restrict motion, const double *restrict hold, const double *restrict p,
                           const double *restrict derived, double *restrict slopes) {
  EACH_CALL one_step_slopes(motion + l, hold + l, p, derived, slopes + l);
}

IN_LANES one_step_product(const double *restrict slopes, const double *restrict motions, const double *restrict holds,
                     double *restrict nexts) {
  EACH_OF(DIRECTIONS) {
    const double *restrict motion_tangent = motions + l, *restrict hold_tangent = holds + l;
    double *restrict next_motion_tangent = nexts + l;
    ONE_STEP_PRODUCT
  }
}
#endif

IN_LANES along_move_lanes(const double *restrict motion, const double *restrict hold, const double *restrict part,
                          const double *restrict p, const double *restrict motion_tangent,
                          const double *restrict hold_tangent, double *restrict next) {
  EACH_CALL_OF(DIRECTIONS) along_move(motion, hold, part, p, motion_tangent + l, hold_tangent + l, next + l);
}

/* One rollout with its sensitivities.
   for_sample_slopes and for_one_step_slopes hold what the slopes take that depends on the parameters alone.
   direction (GAINS, DIRECTIONS) holds the directions; state (STATES) and its tangent (STATES, DIRECTIONS) those at the start,
   and then at the end. Every stride-th sample writes state TRACKED to values and its tangent to tangents (kept, DIRECTIONS);
   both may be null. Returns the outcome as in rollout.c; *done is the number of samples stepped. A tangent that is not
   finite makes no outcome. */
EXPORT int sensitivity(const double *parameters, const double *for_sample_slopes, const double *for_one_step_slopes,
                       const double *direction, const double *exogenous, double *state, double *tangent,
                       int64_t samples, int64_t stride, double *values, double *tangents, int64_t *done) {
  double for_sample[SAMPLE_DERIVED + 1], for_move[MOVE_DERIVED + 1];
  double hold[HOLD], now[STATES], next[STATES], moved[MOTION], margin = 0;
  LANE_ARRAY seeds[GAINS * DIRECTIONS], ours[STATES * DIRECTIONS], theirs[STATES * DIRECTIONS];
  LANE_ARRAY hold_tangent[HOLD * DIRECTIONS];
  Stretch of;
  double *now_tangent = ours, *next_tangent = theirs;
  int outcome = COMPLETED;
  int64_t k = 0;
  memset(&of, 0, sizeof of);
  memcpy(seeds, direction, sizeof seeds);
  memcpy(now, state, sizeof now);
  memcpy(now_tangent, tangent, sizeof ours);
  derive_sample(parameters, for_sample);
  derive_move(parameters, for_move);
  (void)for_one_step_slopes;
#if HAS_ONE_STEP
  double for_one_step[ONE_STEP_DERIVED + 1], valid = 0;
  derive_one_step(parameters, for_one_step);
#endif
  while (k < samples && outcome == COMPLETED) {
    int stepped = 0;
    for (; stepped < LANES && k + stepped < samples && outcome == COMPLETED; ++stepped, exogenous += EXOGENOUS) {
      put(of.state + stepped, now, STATES);
      put(of.exogenous + stepped, exogenous, EXOGENOUS);
      sample(now, exogenous, parameters, for_sample, next + MOTION, hold);
      put(of.hold + stepped, hold, HOLD);
      of.in_one_step[stepped] = 0;
#if HAS_ONE_STEP
      one_step(now, hold, parameters, for_one_step, next, &margin, &valid);
      of.in_one_step[stepped] = valid > 0;
      if (!of.in_one_step[stepped])
#endif
        for (int part = 0; part < PARTS; ++part) {
          const double number = part;
          move(part ? moved : now, hold, &number, parameters, for_move, next, &margin);
          memcpy(moved, next, sizeof moved);
        }
      if (!all_finite(next, STATES)) outcome = DIVERGED;
      else if (margin < 0) outcome = LEFT;
      memcpy(now, next, sizeof now);
    }
    sample_slopes_lanes(of.state, of.exogenous, parameters, for_sample_slopes, of.sample_slopes);
#if HAS_ONE_STEP
    one_step_slopes_lanes(of.state, of.hold, parameters, for_one_step_slopes, of.one_step_slopes);
#endif
    for (int t = 0; t < stepped; ++t, ++k) {
      if (values && k % stride == 0) {
        *values++ = of.state[TRACKED * LANES + t];
        memcpy(tangents, now_tangent + TRACKED * DIRECTIONS, DIRECTIONS * sizeof *tangents);
        tangents += DIRECTIONS;
      }
      sample_product(of.sample_slopes + t, now_tangent, seeds, next_tangent + MOTION * DIRECTIONS, hold_tangent);
#if HAS_ONE_STEP
      if (of.in_one_step[t]) one_step_product(of.one_step_slopes + t, now_tangent, hold_tangent, next_tangent);
      else
#endif
      {
        take(moved, of.state + t, MOTION);
        take(hold, of.hold + t, HOLD);
        for (int part = 0; part < PARTS; ++part) { /* each starts from `moved`, `now_tangent` */
          const double number = part;
          along_move_lanes(moved, hold, &number, parameters, now_tangent, hold_tangent, next_tangent);
          if (part == PARTS - 1) break;
          move(moved, hold, &number, parameters, for_move, next, &margin);
          memcpy(moved, next, sizeof moved);
          memcpy(now_tangent, next_tangent, MOTION * DIRECTIONS * sizeof *now_tangent);
        }
      }
      double *last = now_tangent;
      now_tangent = next_tangent;
      next_tangent = last;
    }
  }
  memcpy(state, now, sizeof now);
  memcpy(tangent, now_tangent, sizeof ours);
  *done = k;
  return outcome;
}
