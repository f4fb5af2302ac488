/* Runs a sampled system with the sensitivities of its state to LANES directions in its parameters, one in each lane.
   Comes after driver.h, elementary.h, the sizes and the functions of codegen/sensitivity.py:
     sloped_sample(state, exogenous, parameters, derived, discrete, held, slopes)
     sloped_leap(motion, held, parameters, derived, next_motion, margin, valid, slopes)
   which also give the slopes that tangents are multiplied with, and over tangents, whose elements lie LANES apart,
     along_move(motion, held, part, parameters, motion_tangent, held_tangent, next_motion_tangent)
   SPREAD_SAMPLE and SPREAD_LEAP are the statements of codegen/spread.py for one lane. */

IN_LANES spread_sample(const double *restrict slopes, const double *restrict states, const double *restrict directions,
                       double *restrict discretes, double *restrict helds) {
  EACH_LANE {
    const double *restrict state_tangent = states + l, *restrict direction = directions + l;
    double *restrict discrete_tangent = discretes + l, *restrict held_tangent = helds + l;
    SPREAD_SAMPLE
  }
}

#if HAS_LEAP
IN_LANES spread_leap(const double *restrict slopes, const double *restrict motions, const double *restrict helds,
                     double *restrict nexts) {
  EACH_LANE {
    const double *restrict motion_tangent = motions + l, *restrict held_tangent = helds + l;
    double *restrict next_motion_tangent = nexts + l;
    SPREAD_LEAP
  }
}
#endif

IN_LANES along_move_lanes(const double *restrict motion, const double *restrict held, const double *restrict part,
                          const double *restrict p, const double *restrict motion_tangent,
                          const double *restrict held_tangent, double *restrict next) {
  EACH_CALL along_move(motion, held, part, p, motion_tangent + l, held_tangent + l, next + l);
}

/* One rollout with its sensitivities.
   direction (GAINS, LANES) holds the directions; state (STATES) and its tangent (STATES, LANES) those at the start,
   and then at the end. Every stride-th sample writes state TRACKED to values and its tangent to tangents (kept, LANES);
   both may be null. Returns the outcome as in rollout.c; *done is the number of samples stepped. A tangent that is not
   finite makes no outcome. */
EXPORT int sensitivity(const double *parameters, const double *direction, const double *exogenous, double *state,
                       double *tangent, int64_t samples, int64_t stride, double *values, double *tangents,
                       int64_t *done) {
  double for_sample[SLOPED_SAMPLE_DERIVED + 1], for_move[MOVE_DERIVED + 1], slopes[SLOPED_SAMPLE_SLOPES + 1];
  double held[HELD], now[STATES], next[STATES], margin = 0;
  LANE_ARRAY seeds[GAINS * LANES], ours[STATES * LANES], theirs[STATES * LANES], held_tangent[HELD * LANES];
  double *now_tangent = ours, *next_tangent = theirs;
  int outcome = COMPLETED;
  int64_t k = 0;
  memcpy(seeds, direction, sizeof seeds);
  memcpy(now, state, sizeof now);
  memcpy(now_tangent, tangent, sizeof ours);
  derive_sloped_sample(parameters, for_sample);
  derive_move(parameters, for_move);
#if HAS_LEAP
  double for_leap[SLOPED_LEAP_DERIVED + 1], leap_slopes[SLOPED_LEAP_SLOPES + 1], valid = 0;
  derive_sloped_leap(parameters, for_leap);
#endif
  for (; k < samples && outcome == COMPLETED; ++k, exogenous += EXOGENOUS) {
    if (values && k % stride == 0) {
      *values++ = now[TRACKED];
      memcpy(tangents, now_tangent + TRACKED * LANES, LANES * sizeof *tangents);
      tangents += LANES;
    }
    sloped_sample(now, exogenous, parameters, for_sample, next + MOTION, held, slopes);
    spread_sample(slopes, now_tangent, seeds, next_tangent + MOTION * LANES, held_tangent);
#if HAS_LEAP
    sloped_leap(now, held, parameters, for_leap, next, &margin, &valid, leap_slopes);
    if (valid > 0) spread_leap(leap_slopes, now_tangent, held_tangent, next_tangent);
    else
#endif
      for (int part = 0; part < PARTS; ++part) { /* each starts from `now`, where the last one is put */
        const double number = part;
        along_move_lanes(now, held, &number, parameters, now_tangent, held_tangent, next_tangent);
        move(now, held, &number, parameters, for_move, next, &margin);
        if (part < PARTS - 1) {
          memcpy(now, next, MOTION * sizeof *now);
          memcpy(now_tangent, next_tangent, MOTION * LANES * sizeof *now_tangent);
        }
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
