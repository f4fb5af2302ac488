/* Runs a sampled system for many samples and LANES sets of parameters at once, one in each vector lane.
   Comes after driver.h, elementary.h, the sizes, the functions of codegen/sampled.py with derive(parameters, derived),
   over arrays of stride LANES, and sampled_lanes.h. If PAIRED, each call processes lanes l and l + LANES/2: the work of
   two vectors is interleaved, to hide the latency of instructions. The exogenous signals are only the READ ones in use,
   those of READ_EXOGENOUS.

   The result of a lane depends on its own numbers alone: lanes never mix. */

#define LOOK_EVERY 64

EXPORT const int signals_read[] = READ_EXOGENOUS;
EXPORT const int64_t signals_read_count = READ;

/* Fills a table (samples, READ, LANES) with signals from the sample `first` on: `fill` of fill.c. */
typedef void (*Fill)(const void *sources, int64_t first, int64_t samples, double *table);

/* What keeps rows: functions and memory of rows.c. */
typedef struct {
  void (*begin)(const double *p, double *derived);
  void (*at)(const double *state, const double *exogenous, const double *p, const double *derived, double *row);
  double *derived;
} Recorder;

static __attribute__((noinline)) int any_at_most_zero(const double *restrict values, const double *restrict others) {
  int64_t found = 0;
  EACH_LANE found |= (values[l] <= 0) | (others[l] <= 0) ? -1 : 0;
  return found != 0;
}

/* Data read and written at every sample, close together and at the same places of the cache in every call. */
typedef struct {
  __attribute__((aligned(4096))) double first[STATES * LANES];
  double second[STATES * LANES], hold[HOLD * LANES];
  double p[sizeof((int[])USED_PARAMETERS) / sizeof(int) * LANES], derived[(DERIVED + 1) * LANES];
  double margin[LANES];
#if HAS_ONE_STEP
  double valid[LANES];
#endif
} Often;

/* One block of LANES rollouts.
   parameters (LANES, PARAMETERS) and state (LANES, STATES) are rows; state is overwritten with the final states.
   `fill` fills tables with the lanes' signals from `sources`, which changes, LOOK_EVERY samples ahead, so that memory
   does not grow with the samples. Every stride-th sample writes a row of each lane to rows (LANES, kept, COLUMNS) by
   `recorder`, which may be null; rows from sample done[l] on are meaningless. outcome and done have LANES elements.

   All states are checked to be finite every LOOK_EVERY samples. If one is not, these samples are repeated with a check
   at each. At the same interval, lanes whose state `watched` exceeds `most` are stopped, as their result is not needed. */
EXPORT void batch(const double *parameters, Fill fill, const void *sources, double *state, int64_t samples,
                  const Recorder *recorder, int64_t stride, double *rows, int64_t kept, int64_t watched, double most,
                  int64_t *outcome, int64_t *done) {
  static const int used[] = USED_PARAMETERS;
  Often often;
  LANE_ARRAY p[PARAMETERS * LANES], row[COLUMNS * LANES];
#if HAS_ONE_STEP
  LANE_ARRAY moved[MOTION * LANES], moved_margin[LANES], missing[LANES];
#else
  LANE_ARRAY all[LANES];
  EACH_LANE all[l] = 1;
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
  derive_lanes(p, often.derived);
  if (recorder) recorder->begin(p, recorder->derived);
  for (int64_t k = 0; k < samples && running > 0; ++k) {
    if (k == filled) {
      filled = k + LOOK_EVERY < samples ? k + LOOK_EVERY : samples;
      fill(sources, k, filled - k, ahead);
    }
    const double *w = ahead + k % LOOK_EVERY * READ * LANES;
    if (recorder && k % stride == 0) {
      recorder->at(now, w, p, recorder->derived, row);
      EACH_LANE
        if (done[l] == samples)
          for (int i = 0; i < COLUMNS; ++i) rows[(l * kept + k / stride) * COLUMNS + i] = row[i * LANES + l];
    }
#if HAS_ONE_STEP
    SAMPLE_BY_PHASE(now, w, often.p, often.derived, next + MOTION * LANES, often.hold, next, often.margin, often.valid);
    int suspect = any_at_most_zero(often.valid, often.margin);
    if (suspect) {
      int any = 0;
      EACH_LANE {
        missing[l] = !(often.valid[l] > 0) && done[l] == samples;
        any += missing[l] > 0;
      }
      if (any) {
        move_on(missing, now, often.hold, p, often.derived, moved, moved_margin);
        take_over(missing, next, moved, MOTION);
        take_over(missing, often.margin, moved_margin, 1);
      }
    }
#else
    SAMPLE_BY_PHASE(now, w, often.p, often.derived, next + MOTION * LANES, often.hold);
    move_on(all, now, often.hold, p, often.derived, next, often.margin);
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
