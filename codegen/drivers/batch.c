/* Runs a sampled system for many samples and LANES sets of parameters at once, one in each vector lane.
   Comes after driver.h, elementary.h, the sizes, the functions of codegen/sampled.py, each with its
   derive_NAME(parameters, derived), over arrays of stride LANES, and sampled_lanes.h. The work of two vectors is
   interleaved to hide the latency of instructions: if PAIRED, each call processes lanes l and l + LANES/2, else the
   compiler interleaves. The exogenous signals are only the READ ones in use, those of READ_EXOGENOUS.

   The result of a lane depends on its own numbers alone: lanes never mix. */

#define LOOK_EVERY 64

EXPORT const int signals_read[] = READ_EXOGENOUS;
EXPORT const int64_t signals_read_count = READ;

IN_LANES derive_lanes(const double *restrict p, double *restrict for_sample, double *restrict for_observe,
                      double *restrict for_move) {
  EACH_CALL {
    derive_sample(p + l, for_sample + l);
    derive_observe(p + l, for_observe + l);
    derive_move(p + l, for_move + l);
  }
}

#if HAS_FAST_SAMPLE
IN_LANES derive_fast_sample_lanes(const double *restrict p, double *restrict for_fast_sample) {
  EACH_CALL derive_fast_sample(p + l, for_fast_sample + l);
}
#endif

#if HAS_ONE_STEP
IN_LANES derive_one_step_lanes(const double *restrict p, double *restrict for_one_step) {
  EACH_CALL derive_one_step(p + l, for_one_step + l);
}
#endif

/* Fills a table (samples, READ, LANES) with signals from the sample `first` on: `fill` of fill.c. */
typedef void (*Fill)(const void *sources, int64_t first, int64_t samples, double *table);

static __attribute__((noinline)) int any_at_most_zero(const double *restrict values, const double *restrict others) {
  int64_t found = 0;
  EACH_LANE found |= (values[l] <= 0) | (others[l] <= 0) ? -1 : 0;
  return found != 0;
}

/* Data read and written at every sample, close together and at the same places of the cache in every call. */
typedef struct {
  __attribute__((aligned(4096))) double first[STATES * LANES];
  double second[STATES * LANES], hold[HOLD * LANES];
  double p[sizeof((int[])USED_PARAMETERS) / sizeof(int) * LANES], for_sample[(SAMPLE_DERIVED + 1) * LANES];
  double margin[LANES];
#if HAS_ONE_STEP
  double for_one_step[(ONE_STEP_DERIVED + 1) * LANES], valid[LANES];
#endif
#if HAS_FAST_SAMPLE
  double for_fast_sample[(FAST_SAMPLE_DERIVED + 1) * LANES];
#endif
} Often;

/* One block of LANES rollouts.
   parameters (LANES, PARAMETERS) and state (LANES, STATES) are rows; state is overwritten with the final states.
   `fill` fills tables with the lanes' signals from `sources`, which changes, LOOK_EVERY samples ahead, so that memory
   does not grow with the samples. Every stride-th sample writes a row of each lane to rows (LANES, kept, COLUMNS); rows
   may be null; rows from sample done[l] on are meaningless. outcome and done have LANES elements.

   All states are checked to be finite every LOOK_EVERY samples. If one is not, these samples are repeated with a check
   at each. At the same interval, lanes whose state `watched` exceeds `most` are stopped, as their result is not needed. */
EXPORT void batch(const double *parameters, Fill fill, const void *sources, double *state, int64_t samples, int64_t stride,
                  double *rows, int64_t kept, int64_t watched, double most, int64_t *outcome, int64_t *done) {
  static const int used[] = USED_PARAMETERS;
  Often often;
  LANE_ARRAY p[PARAMETERS * LANES], row[COLUMNS * LANES], for_observe[(OBSERVE_DERIVED + 1) * LANES];
  LANE_ARRAY for_move[(MOVE_DERIVED + 1) * LANES];
#if HAS_ONE_STEP
  LANE_ARRAY moved[MOTION * LANES], moved_margin[LANES], missing[LANES];
#endif
  LANE_ARRAY kept_state[STATES * LANES];
  uint64_t finite[LANES];
  int64_t kept_at = 0, watch_until = 0;
  double *now = often.first, *next = often.second;
  int running = LANES;
  LANE_ARRAY ahead[LOOK_EVERY * READ * LANES];
  int64_t filled = 0;
  EACH_LANE {
    for (int i = 0; i < PARAMETERS; ++i) p[i * LANES + l] = parameters[l * PARAMETERS + i];
    for (int i = 0; i < (int)(sizeof used / sizeof *used); ++i)
      often.p[i * LANES + l] = parameters[l * PARAMETERS + used[i]];
    for (int i = 0; i < STATES; ++i) now[i * LANES + l] = state[l * STATES + i];
    outcome[l] = COMPLETED;
    done[l] = samples;
  }
  memcpy(kept_state, now, sizeof kept_state);
  derive_lanes(p, often.for_sample, for_observe, for_move);
#if HAS_ONE_STEP
  derive_one_step_lanes(p, often.for_one_step);
#endif
#if HAS_FAST_SAMPLE
  derive_fast_sample_lanes(p, often.for_fast_sample);
#endif
  for (int64_t k = 0; k < samples && running > 0; ++k) {
    if (k == filled) {
      filled = k + LOOK_EVERY < samples ? k + LOOK_EVERY : samples;
      fill(sources, k, filled - k, ahead);
    }
    const double *w = ahead + k % LOOK_EVERY * READ * LANES;
    if (rows && k % stride == 0) {
      observe_lanes(now, w, p, for_observe, row);
      EACH_LANE
        if (done[l] == samples)
          for (int i = 0; i < COLUMNS; ++i) rows[(l * kept + k / stride) * COLUMNS + i] = row[i * LANES + l];
    }
#if HAS_FAST_SAMPLE
    const int fast = all_fast(now + PHASE * LANES);
#endif
#if HAS_ONE_STEP
#if HAS_FAST_SAMPLE
    if (fast)
      fast_sample_and_one_step_lanes(now, w, often.p, often.for_fast_sample, often.for_one_step, next + MOTION * LANES,
                                     often.hold, next, often.margin, often.valid);
    else
#endif
      sample_and_one_step_lanes(now, w, often.p, often.for_sample, often.for_one_step, next + MOTION * LANES, often.hold,
                                next, often.margin, often.valid);
    int suspect = any_at_most_zero(often.valid, often.margin);
    if (suspect) {
      int any = 0;
      EACH_LANE {
        missing[l] = often.valid[l] > 0 ? 0 : 1;
        any += missing[l] > 0 && done[l] == samples;
      }
      if (any) {
        move_on(now, often.hold, p, for_move, moved, moved_margin);
        take_over(missing, next, moved, MOTION);
        take_over(missing, often.margin, moved_margin, 1);
      }
    }
#else
#if HAS_FAST_SAMPLE
    if (fast) fast_sample_lanes(now, w, often.p, often.for_fast_sample, next + MOTION * LANES, often.hold);
    else
#endif
      sample_lanes(now, w, often.p, often.for_sample, next + MOTION * LANES, often.hold);
    move_on(now, often.hold, p, for_move, next, often.margin);
    int suspect = any_at_most_zero(often.margin, often.margin);
#endif
    int look = (k + 1) % LOOK_EVERY == 0 || k == samples - 1;
    if (look || k < watch_until || suspect) {
      find_finite(next, finite);
      int lost = 0;
      EACH_LANE lost += !finite[l] && done[l] == samples;
      if (lost && k >= watch_until) {
        memcpy(now, kept_state, sizeof kept_state);
        watch_until = k + 1;
        k = kept_at - 1;
        continue;
      }
      EACH_LANE {
        if (done[l] < samples || (finite[l] && !(often.margin[l] < 0))) continue;
        outcome[l] = finite[l] ? LEFT : DIVERGED;
        done[l] = k + 1;
        --running;
        for (int i = 0; i < STATES; ++i) state[l * STATES + i] = next[i * LANES + l];
      }
    }
    if (look && k + 1 < samples) {
      const double *seen = next + watched * LANES;
      EACH_LANE {
        if (done[l] < samples || !(seen[l] > most)) continue;
        outcome[l] = GIVEN_UP;
        done[l] = k + 1;
        --running;
      }
    }
    double *last = now;
    now = next;
    next = last;
    if (look) {
      memcpy(kept_state, now, sizeof kept_state);
      kept_at = k + 1;
    }
  }
  EACH_LANE
    if (outcome[l] == COMPLETED)
      for (int i = 0; i < STATES; ++i) state[l * STATES + i] = now[i * LANES + l];
}
