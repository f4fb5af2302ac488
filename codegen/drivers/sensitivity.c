/* Runs a sampled system with the sensitivities of its state along directions of its parameters.
   LANES samples are stepped, then their slopes computed in parallel, a sample in each lane, then the tangents propagated
   through these samples in sequence, a direction in each lane.
   Comes after vectors.h, elementary.h, the sizes and the functions of codegen/drivers/sensitivity.py: those of
   codegen/sampled.py with derive(parameters, derived), and over arrays of stride LANES
     sample_slopes(state, exogenous, parameters, derived, slopes)
     one_step_slopes(motion, hold, parameters, derived, slopes)
     observe_slopes(state, exogenous, parameters, derived, slopes)
   and with tangents of stride DIRECTIONS
     along_move(motion, hold, part, parameters, motion_tangent, hold_tangent, direction, next_motion_tangent).
   SAMPLE_PRODUCT, ONE_STEP_PRODUCT and OBSERVE_PRODUCT are the statements of codegen/drivers/tangents.py:
   tangents of the outputs from slopes and tangents of the inputs. `observe` writes the ROW requested columns. */

enum { VECTORS = DIRECTIONS / VECTOR };

/* The states and exogenous signals that slopes read; the motion is first among them. */
static const int read_state[] = READ_STATE, read_exogenous[] = READ_EXOGENOUS;
enum { STATES_READ = sizeof read_state / sizeof(int), EXOGENOUS_READ = sizeof read_exogenous / sizeof(int) };

/* Arguments of the slopes of LANES samples of the run. Element i of sample t is at [i * LANES + t]. */
typedef struct {
  LANE_ARRAY state[STATES_READ * LANES], exogenous[EXOGENOUS_READ * LANES], hold[HOLD * LANES];
  LANE_ARRAY sample_slopes[(SAMPLE_SLOPES + 1) * LANES];
#if HAS_ONE_STEP
  LANE_ARRAY one_step_slopes[(ONE_STEP_SLOPES + 1) * LANES];
#endif
#if ROW
  LANE_ARRAY observe_slopes[(OBSERVE_SLOPES + 1) * LANES];
#endif
  int in_one_step[LANES]; /* whether the one-step update was valid */
} Stretch;

static inline void put(double *to, const double *values, int count) {
  for (int i = 0; i < count; ++i) to[i * LANES] = values[i];
}

static inline void put_chosen(double *to, const double *values, const int *chosen, int count) {
  for (int i = 0; i < count; ++i) to[i * LANES] = values[chosen[i]];
}

static inline void take(double *values, const double *from, int count) {
  for (int i = 0; i < count; ++i) values[i] = from[i * LANES];
}

IN_LANES sample_slopes_lanes(const double *restrict state, const double *restrict exogenous, const double *restrict p,
                             const double *restrict derived, double *restrict slopes) {
  EACH_CALL sample_slopes(state + l, exogenous + l, p, derived, slopes + l);
}

IN_LANES sample_product(const double *restrict slopes, const void *states, const void *directions,
                        const void *signals, void *discretes, void *holds) {
  EACH_GROUP {
    const Vector *restrict state_tangent = (const Vector *)states + at;
    const Vector *restrict direction = (const Vector *)directions + at;
    const Vector *restrict signal_tangent = (const Vector *)signals + at;
    Vector *restrict discrete_tangent = (Vector *)discretes + at, *restrict hold_tangent = (Vector *)holds + at;
    (void)direction, (void)signal_tangent;
    SAMPLE_PRODUCT
  }
}

#if HAS_ONE_STEP
IN_LANES one_step_slopes_lanes(const double *restrict motion, const double *restrict hold, const double *restrict p,
                           const double *restrict derived, double *restrict slopes) {
  EACH_CALL one_step_slopes(motion + l, hold + l, p, derived, slopes + l);
}

IN_LANES one_step_product(const double *restrict slopes, const void *motions, const void *holds,
                          const void *directions, void *nexts) {
  EACH_GROUP {
    const Vector *restrict motion_tangent = (const Vector *)motions + at;
    const Vector *restrict hold_tangent = (const Vector *)holds + at;
    const Vector *restrict direction = (const Vector *)directions + at;
    Vector *restrict next_motion_tangent = (Vector *)nexts + at;
    (void)direction;
    ONE_STEP_PRODUCT
  }
}
#endif

#if ROW
IN_LANES observe_slopes_lanes(const double *restrict state, const double *restrict exogenous, const double *restrict p,
                              const double *restrict derived, double *restrict slopes) {
  EACH_CALL observe_slopes(state + l, exogenous + l, p, derived, slopes + l);
}

IN_LANES observe_product(const double *restrict slopes, const void *states, const void *directions,
                         const void *signals, void *rows) {
  EACH_GROUP {
    const Vector *restrict state_tangent = (const Vector *)states + at;
    const Vector *restrict direction = (const Vector *)directions + at;
    const Vector *restrict signal_tangent = (const Vector *)signals + at;
    Vector *restrict row_tangent = (Vector *)rows + at;
    (void)slopes, (void)direction, (void)signal_tangent;
    OBSERVE_PRODUCT
  }
}
#endif

IN_LANES along_move_lanes(const double *restrict motion, const double *restrict hold, const double *restrict part,
                          const double *restrict p, const double *restrict motion_tangent,
                          const double *restrict hold_tangent, const double *restrict direction,
                          double *restrict next) {
  EACH_CALL_OF(DIRECTIONS)
  along_move(motion, hold, part, p, motion_tangent + l, hold_tangent + l, direction + l, next + l);
}

/* One rollout with its sensitivities.
   for_slopes holds the values that the slopes derive from the parameters alone. direction (VARIED, DIRECTIONS) holds the
   directions, signals (samples, SIGNALS, DIRECTIONS) the tangents of exogenous signals; state (STATES) and its tangent
   (STATES, DIRECTIONS) are initial values, and then the final ones. Every stride-th sample writes state TRACKED to values and its tangent to tangents (kept, DIRECTIONS),
   columns to rows (kept, ROW) and their tangents to row_tangents (kept, ROW, DIRECTIONS); all four may be null. Returns
   the outcome as in rollout.c; *done is the number of samples stepped. Tangents do not affect the outcome. */
EXPORT int sensitivity(const double *parameters, const double *for_slopes, const double *direction, const double *exogenous,
                       const double *signals, double *state, double *tangent, int64_t samples, int64_t stride,
                       double *values, double *tangents, double *rows, double *row_tangents, int64_t *done) {
  double derived[DERIVED + 1], hold[HOLD], now[STATES], next[STATES], moved[MOTION], margin = 0;
  LANE_ARRAY seeds[(VARIED + 1) * DIRECTIONS], ours[STATES * DIRECTIONS], theirs[STATES * DIRECTIONS];
  LANE_ARRAY hold_tangent[HOLD * DIRECTIONS];
  Stretch of;
  double *now_tangent = ours, *next_tangent = theirs;
  int outcome = COMPLETED;
  int64_t k = 0;
  memset(&of, 0, sizeof of);
  memcpy(seeds, direction, VARIED * DIRECTIONS * sizeof *seeds);
  memcpy(now, state, sizeof now);
  memcpy(now_tangent, tangent, sizeof ours);
  (void)rows, (void)row_tangents;
#if HAS_ONE_STEP
  double valid = 0;
#endif
  derive(parameters, derived);
  while (k < samples && outcome == COMPLETED) {
    int stepped = 0;
    for (; stepped < LANES && k + stepped < samples && outcome == COMPLETED; ++stepped, exogenous += EXOGENOUS) {
      put_chosen(of.state + stepped, now, read_state, STATES_READ);
      put_chosen(of.exogenous + stepped, exogenous, read_exogenous, EXOGENOUS_READ);
#if ROW
      if (rows && (k + stepped) % stride == 0) {
        observe(now, exogenous, parameters, derived, rows);
        rows += ROW;
      }
#endif
#if HAS_FAST_SAMPLE
      if (now[PHASE] != 0) fast_sample(now, exogenous, parameters, derived, next + MOTION, hold);
      else
#endif
        sample(now, exogenous, parameters, derived, next + MOTION, hold);
      put(of.hold + stepped, hold, HOLD);
      of.in_one_step[stepped] = 0;
#if HAS_ONE_STEP
      one_step(now, hold, parameters, derived, next, &margin, &valid);
      of.in_one_step[stepped] = valid > 0;
      if (!of.in_one_step[stepped])
#endif
        for (int part = 0; part < PARTS; ++part) {
          const double number = part;
          move(part ? moved : now, hold, &number, parameters, derived, next, &margin);
          memcpy(moved, next, sizeof moved);
        }
      if (!all_finite(next, STATES)) outcome = DIVERGED;
      else if (margin < 0) outcome = LEFT;
      memcpy(now, next, sizeof now);
    }
    sample_slopes_lanes(of.state, of.exogenous, parameters, for_slopes, of.sample_slopes);
#if HAS_ONE_STEP
    one_step_slopes_lanes(of.state, of.hold, parameters, for_slopes, of.one_step_slopes);
#endif
#if ROW
    if (rows) observe_slopes_lanes(of.state, of.exogenous, parameters, for_slopes, of.observe_slopes);
#endif
    for (int t = 0; t < stepped; ++t, ++k, signals += SIGNALS * DIRECTIONS) {
      if (values && k % stride == 0) {
        *values++ = of.state[TRACKED * LANES + t];
        memcpy(tangents, now_tangent + TRACKED * DIRECTIONS, DIRECTIONS * sizeof *tangents);
        tangents += DIRECTIONS;
      }
#if ROW
      if (row_tangents && k % stride == 0) {
        observe_product(of.observe_slopes + t, now_tangent, seeds, signals, row_tangents);
        row_tangents += ROW * DIRECTIONS;
      }
#endif
      double *discrete_tangent = next_tangent + MOTION * DIRECTIONS;
      sample_product(of.sample_slopes + t, now_tangent, seeds, signals, discrete_tangent, hold_tangent);
#if HAS_ONE_STEP
      if (of.in_one_step[t]) one_step_product(of.one_step_slopes + t, now_tangent, hold_tangent, seeds, next_tangent);
      else
#endif
      {
        take(moved, of.state + t, MOTION);
        take(hold, of.hold + t, HOLD);
        for (int part = 0; part < PARTS; ++part) { /* each starts from `moved`, `now_tangent` */
          const double number = part;
          along_move_lanes(moved, hold, &number, parameters, now_tangent, hold_tangent, seeds, next_tangent);
          if (part == PARTS - 1) break;
          move(moved, hold, &number, parameters, derived, next, &margin);
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
