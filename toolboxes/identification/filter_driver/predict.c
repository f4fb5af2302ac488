/* Predictions over a log with given gains, with their exact derivatives by the fitted parameters: LANES samples of the run,
   then their slopes in parallel, a sample in each lane, then the tangents through these samples in sequence, a fitted
   parameter in each lane. Comes after kalman.c. */

/* Arguments of the slopes of LANES samples of the run. Element i of sample t is at [i * LANES + t]. */
typedef struct {
  LANE_ARRAY before[STATES * LANES], after[STATES * LANES], input[INPUTS * LANES], hold[HOLD * LANES];
  LANE_ARRAY sense[(SENSE_SLOPES + 1) * LANES], prepare[(PREPARE_SLOPES + 1) * LANES];
#if HAS_ONE_STEP
  LANE_ARRAY one_step[(ONE_STEP_SLOPES + 1) * LANES];
#endif
  double innovation[READINGS * LANES];
  int in_one_step[LANES];
} Stretch;

static inline void put(double *to, const double *values, int count) {
  for (int i = 0; i < count; ++i) to[i * LANES] = values[i];
}

static inline void take(double *values, const double *from, int count) {
  for (int i = 0; i < count; ++i) values[i] = from[i * LANES];
}

IN_LANES sense_slopes_lanes(const double *restrict state, const double *restrict input, const double *restrict p,
                            const double *restrict derived, double *restrict slopes) {
  EACH_CALL sense_slopes(state + l, input + l, p, derived, slopes + l);
}

IN_LANES prepare_slopes_lanes(const double *restrict state, const double *restrict input, const double *restrict p,
                              const double *restrict derived, double *restrict slopes) {
  EACH_CALL prepare_slopes(state + l, input + l, p, derived, slopes + l);
}

IN_LANES sense_ways(const double *restrict slopes, const void *states, const void *directions, void *readings) {
  enum { VECTORS = WAYS / VECTOR };
  EACH_GROUP {
    const Vector *restrict state_tangent = (const Vector *)states + at;
    const Vector *restrict direction = (const Vector *)directions + at;
    Vector *restrict reading_tangent = (Vector *)readings + at;
    (void)direction;
    SENSE_BY_ALL
  }
}

IN_LANES prepare_ways(const double *restrict slopes, const void *states, const void *directions, void *rests,
                      void *holds) {
  enum { VECTORS = WAYS / VECTOR };
  EACH_GROUP {
    const Vector *restrict state_tangent = (const Vector *)states + at;
    const Vector *restrict direction = (const Vector *)directions + at;
    Vector *restrict rest_tangent = (Vector *)rests + at, *restrict hold_tangent = (Vector *)holds + at;
    (void)direction;
    PREPARE_BY_ALL
  }
}

IN_LANES move_ways(const double *restrict slopes, const void *motions, const void *holds, const void *directions,
                   void *nexts) {
  enum { VECTORS = WAYS / VECTOR };
  EACH_GROUP {
    const Vector *restrict motion_tangent = (const Vector *)motions + at;
    const Vector *restrict hold_tangent = (const Vector *)holds + at;
    const Vector *restrict direction = (const Vector *)directions + at;
    Vector *restrict next_motion_tangent = (Vector *)nexts + at;
    (void)direction;
    MOVE_BY_ALL
  }
}

#if HAS_ONE_STEP
IN_LANES one_step_slopes_lanes(const double *restrict motion, const double *restrict hold, const double *restrict p,
                               const double *restrict derived, double *restrict slopes) {
  EACH_CALL one_step_slopes(motion + l, hold + l, p, derived, slopes + l);
}

IN_LANES one_step_ways(const double *restrict slopes, const void *motions, const void *holds, const void *directions,
                       void *nexts) {
  enum { VECTORS = WAYS / VECTOR };
  EACH_GROUP {
    const Vector *restrict motion_tangent = (const Vector *)motions + at;
    const Vector *restrict hold_tangent = (const Vector *)holds + at;
    const Vector *restrict direction = (const Vector *)directions + at;
    Vector *restrict next_motion_tangent = (Vector *)nexts + at;
    (void)direction;
    ONE_STEP_BY_ALL
  }
}
#endif

/* The state at the next sample; returns whether the one-step update was valid. */
static int advance(const double *state, const double *hold, const double *parameters, const double *derived, double *next,
                   double *margin) {
  double motion[MOTION], valid = 0;
#if HAS_ONE_STEP
  one_step(state, hold, parameters, derived, next, margin, &valid);
  if (valid > 0) return 1;
#endif
  memcpy(motion, state, sizeof motion);
  for (int part = 0; part < PARTS; ++part) {
    const double number = part;
    move(motion, hold, &number, parameters, derived, next, margin);
    memcpy(motion, next, sizeof motion);
  }
  return 0;
}

/* Tangents of the motion at the next sample, part by part. */
static void carry_by_parts(const Stretch *of, int t, const double *parameters, const double *derived,
                           const double *directions, const double *tangents, const double *held, double *next) {
  double motion[MOTION], hold[HOLD], there[MOTION], slopes[LINEAR_MOVE_SLOPES + 1], margin;
  LANE_ARRAY between[MOTION * WAYS];
  take(motion, of->after + t, MOTION);
  take(hold, of->hold + t, HOLD);
  for (int part = 0; part < PARTS; ++part) {
    const double number = part;
    double *to = (PARTS - part) % 2 ? next : between;
    linear_move(motion, hold, &number, parameters, derived, there, &margin, slopes);
    move_ways(slopes, tangents, held, directions, to);
    memcpy(motion, there, sizeof motion);
    tangents = to;
  }
}

/* Predicts the log with gains and whitening of `filter`. normal ((FITTED + 1)²), overwritten: sums over all readings of the
   products of the whitened innovations' derivatives by the fitted parameters and, last, of the innovations themselves.
   innovations (samples × READINGS, whitened; NaN for missing readings) may be null. Otherwise as `filter`. */
EXPORT int predict(const double *parameters, const double *inputs, const double *readings, int64_t samples,
                   const double *start, const double *gains, const double *whitening, double *normal,
                   double *innovations, int64_t *done) {
  double derived[DERIVED + 1];
  Stretch of;
  double state[STATES], next[STATES], expected[READINGS], hold[HOLD], margin = 0;
  LANE_ARRAY ours[STATES * WAYS] = {0}, theirs[STATES * WAYS], held[HOLD * WAYS], raw[READINGS * WAYS], white[WAYS];
  LANE_ARRAY directions[FITTED * WAYS + 1] = {0}, sums[(FITTED + 1) * WAYS] = {0};
  double *tangents = ours, *next_tangents = theirs;
  int outcome = COMPLETED;
  int64_t k = 0;
  memset(&of, 0, sizeof of);
  for (int j = 0; j < FITTED; ++j) directions[j * WAYS + j] = 1;
  derive(parameters, derived);
  memcpy(state, start, sizeof state);
  while (k < samples && outcome == COMPLETED) {
    int stepped = 0;
    for (; stepped < LANES && k + stepped < samples && outcome == COMPLETED; ++stepped) {
      const double *input = inputs + (k + stepped) * INPUTS, *gain = gains + (k + stepped) * GAINS;
      put(of.before + stepped, state, STATES);
      put(of.input + stepped, input, INPUTS);
      sense(state, input, parameters, derived, expected);
      for (int i = 0; i < READINGS; ++i) {
        const double innovation = readings[(k + stepped) * READINGS + i] - expected[i];
        of.innovation[stepped * READINGS + i] = innovation;
        if (!absent(innovation)) add(state, innovation, gain + i * STATES, STATES);
      }
      put(of.after + stepped, state, STATES);
      prepare(state, input, parameters, derived, next + MOTION, hold);
      put(of.hold + stepped, hold, HOLD);
      of.in_one_step[stepped] = advance(state, hold, parameters, derived, next, &margin);
      memcpy(state, next, sizeof state);
      if (!all_finite(state, STATES)) outcome = DIVERGED;
      else if (margin < 0) outcome = LEFT;
    }
    sense_slopes_lanes(of.before, of.input, parameters, derived, of.sense);
    prepare_slopes_lanes(of.after, of.input, parameters, derived, of.prepare);
#if HAS_ONE_STEP
    one_step_slopes_lanes(of.after, of.hold, parameters, derived, of.one_step);
#endif
    for (int t = 0; t < stepped; ++t, ++k) {
      const double *gain = gains + k * GAINS, *by = whitening + k * WHITENING, *innovation = of.innovation + t * READINGS;
      sense_ways(of.sense + t, tangents, directions, raw);
      for (int i = 0; i < READINGS; ++i) {
        if (absent(innovation[i])) continue;
        for (int s = 0; s < STATES; ++s) add(tangents + s * WAYS, -gain[i * STATES + s], raw + i * WAYS, WAYS);
        raw[i * WAYS + FITTED] = -innovation[i];
      }
      for (int i = 0; i < READINGS; ++i) {
        if (innovations) *innovations++ = innovation[i];
        if (absent(innovation[i])) continue;
        memset(white, 0, sizeof white);
        for (int j = 0; j <= i; ++j)
          if (!absent(innovation[j])) add(white, -by[i * READINGS + j], raw + j * WAYS, WAYS);
        for (int a = 0; a <= FITTED; ++a) add(sums + a * WAYS, white[a], white, WAYS);
        if (innovations) innovations[-1] = white[FITTED];
      }
      prepare_ways(of.prepare + t, tangents, directions, next_tangents + MOTION * WAYS, held);
#if HAS_ONE_STEP
      if (of.in_one_step[t]) one_step_ways(of.one_step + t, tangents, held, directions, next_tangents);
      else
#endif
        carry_by_parts(&of, t, parameters, derived, directions, tangents, held, next_tangents);
      double *last = tangents;
      tangents = next_tangents;
      next_tangents = last;
    }
  }
  for (int a = 0; a <= FITTED; ++a) memcpy(normal + a * (FITTED + 1), sums + a * WAYS, (FITTED + 1) * sizeof *normal);
  *done = k;
  return outcome;
}
