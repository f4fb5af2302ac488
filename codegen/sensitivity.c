/* Runs a sampled system with the sensitivities of its state to LANES directions in its parameters, one in each lane.
   Comes after driver.h, elementary.h, the sizes and the functions of codegen/sampled.py; of codegen/sensitivity.py
     slopes_sample(state, exogenous, parameters, derived, slopes)      what the next two multiply tangents with
     slopes_leap(motion, held, parameters, derived, slopes)
   and over arrays of tangents, whose elements lie LANES apart,
     spread_sample(slopes, state_tangent, direction, discrete_tangent, held_tangent)
     spread_leap(slopes, motion_tangent, held_tangent, next_motion_tangent)
     along_move(motion, held, parameters, motion_tangent, held_tangent, next_motion_tangent) */

#define IN_LANES static __attribute__((noinline)) void
#if PAIRED
#define EACH_CALL for (int l = 0; l < LANES / 2; ++l)
#else
#define EACH_CALL _Pragma("clang loop vectorize(enable) interleave_count(2)") for (int l = 0; l < LANES; ++l)
#endif
#define LANE_ARRAY __attribute__((aligned(64))) double

IN_LANES spread_sample_lanes(const double *restrict slopes, const double *restrict state,
                             const double *restrict direction, double *restrict discrete, double *restrict held) {
  EACH_CALL spread_sample(slopes, state + l, direction + l, discrete + l, held + l);
}

#if HAS_LEAP
IN_LANES spread_leap_lanes(const double *restrict slopes, const double *restrict motion, const double *restrict held,
                           double *restrict next) {
  EACH_CALL spread_leap(slopes, motion + l, held + l, next + l);
}
#endif

IN_LANES along_move_lanes(const double *restrict motion, const double *restrict held, const double *restrict p,
                          const double *restrict motion_tangent, const double *restrict held_tangent,
                          double *restrict next) {
  EACH_CALL along_move(motion, held, p, motion_tangent + l, held_tangent + l, next + l);
}

static int all_finite(const double *values, int count) {
  uint64_t overflows = 0;
  for (int i = 0; i < count; ++i) overflows |= overflow(values[i]);
  return !(overflows >> 63);
}

/* One rollout with its sensitivities.
   direction (GAINS, LANES) holds the directions; state (STATES) and its tangent (STATES, LANES) those at the start,
   and then at the end. Every stride-th sample writes state TRACKED to values and its tangent to tangents (kept, LANES);
   both may be null. Returns the outcome as in rollout.c; *done is the number of samples stepped. A tangent that is not
   finite makes no outcome. */
EXPORT int sensitivity(const double *parameters, const double *direction, const double *exogenous, double *state,
                       double *tangent, int64_t samples, int64_t stride, double *values, double *tangents,
                       int64_t *done) {
  double for_sample[SAMPLE_DERIVED + 1], for_move[MOVE_DERIVED + 1], for_slopes[SLOPES_SAMPLE_DERIVED + 1];
  double held[HELD], now[STATES], next[STATES], slopes[SAMPLE_SLOPES + 1], margin = 0;
  LANE_ARRAY seeds[GAINS * LANES], ours[STATES * LANES], theirs[STATES * LANES], held_tangent[HELD * LANES];
  double *now_tangent = ours, *next_tangent = theirs;
  int outcome = COMPLETED;
  int64_t k = 0;
  memcpy(seeds, direction, sizeof seeds);
  memcpy(now, state, sizeof now);
  memcpy(now_tangent, tangent, sizeof ours);
  derive_sample(parameters, for_sample);
  derive_move(parameters, for_move);
  derive_slopes_sample(parameters, for_slopes);
#if HAS_LEAP
  double for_leap[LEAP_DERIVED + 1], for_leap_slopes[SLOPES_LEAP_DERIVED + 1], leap_slopes[LEAP_SLOPES + 1], valid = 0;
  derive_leap(parameters, for_leap);
  derive_slopes_leap(parameters, for_leap_slopes);
#endif
  for (; k < samples && outcome == COMPLETED; ++k, exogenous += EXOGENOUS) {
    if (values && k % stride == 0) {
      *values++ = now[TRACKED];
      memcpy(tangents, now_tangent + TRACKED * LANES, LANES * sizeof *tangents);
      tangents += LANES;
    }
    sample(now, exogenous, parameters, for_sample, next + MOTION, held);
    slopes_sample(now, exogenous, parameters, for_slopes, slopes);
    spread_sample_lanes(slopes, now_tangent, seeds, next_tangent + MOTION * LANES, held_tangent);
#if HAS_LEAP
    leap(now, held, parameters, for_leap, next, &margin, &valid);
    if (valid > 0) {
      slopes_leap(now, held, parameters, for_leap_slopes, leap_slopes);
      spread_leap_lanes(leap_slopes, now_tangent, held_tangent, next_tangent);
    } else
#endif
    {
      move(now, held, parameters, for_move, next, &margin);
      along_move_lanes(now, held, parameters, now_tangent, held_tangent, next_tangent);
    }
    if (!all_finite(next, STATES)) outcome = DIVERGED;
    else if (margin < 0) outcome = LEFT;
    memcpy(now, next, sizeof now);
    double *last = now_tangent;
    now_tangent = next_tangent;
    next_tangent = last;
  }
  memcpy(state, now, sizeof now);
  memcpy(tangent, now_tangent, sizeof ours);
  *done = k;
  return outcome;
}
