/* A whole run of the closed loop, from the settings of a page to rows and figures of merit. Comes after rollout.c, fill.c
   and their functions, those of lab/wasm/settings.py, and the sizes and streams of lab/wasm/source.py.

   Vectors are static; the functions below return their addresses. The page provides memory for columns. */

#define PAGE(name) __attribute__((export_name(#name)))

enum { AHEAD = 1024 }; /* samples whose signals are drawn at a time */

static double settings[SETTINGS], parameters[PARAMETERS], state[STATES], metrics[METRICS], checks[CHECKS];
static double table[AHEAD * EXOGENOUS], rows[AHEAD * COLUMNS];
static Signal signals[EXOGENOUS];
static Bundle bundles[EXOGENOUS];
static int64_t stepped;

PAGE(settings) double *settings_at(void) { return settings; }
PAGE(metrics) double *metrics_at(void) { return metrics; }
PAGE(checks) double *checks_at(void) { return checks; }
PAGE(stepped) double stepped_so_far(void) { return (double)stepped; }

static int64_t whole(double samples) {
  return samples < 1 ? 1 : samples > INT32_MAX ? INT32_MAX : llrint(samples);
}

static void set_signals_up(uint64_t seed) {
  static const uint64_t streams[] = STREAMS;
  double random[EXOGENOUS * KINDS];
  drawn(settings, random);
  memset(signals, 0, sizeof signals);
  for (int i = 0; i < EXOGENOUS; ++i) {
    const double *kind = random + i * KINDS;
    signals[i] = (Signal){.kind = (int64_t)kind[0], .seed = seed, .stream = streams[i], .sigma = kind[1],
                          .decay = kind[2], .limit = kind[3], .period = whole(kind[4]), .length = whole(kind[5]),
                          .from_zero = (int64_t)kind[6]};
  }
}

/* Number of samples of the run. */
PAGE(samples) double samples(void) {
  double duration;
  duration_of(settings, &duration);
  return nearbyint(duration / settings[SAMPLE_TIME]);
}

/* Copies `count` rows into columns of a length, starting at row `first`. */
static void put_rows(int64_t first, int64_t count, double *columns, int64_t length) {
  for (int64_t k = 0; k < count; ++k)
    for (int i = 0; i < COLUMNS; ++i) columns[i * length + first + k] = rows[k * COLUMNS + i];
}

/* Runs `samples` samples and writes every `stride`-th row (1 to AHEAD) into `columns` (COLUMNS, rows), which may be null.
   The seed comes in two halves. Returns the outcome, or -1 for a stride out of range. */
PAGE(run) int run(uint32_t seed_low, uint32_t seed_high, int samples, int stride, double *columns) {
  static const int given_at_index[] = GIVEN_AT;
  static const int64_t source[] = {0};
  const double beginning = 0; /* of the reference */
  double for_motion[MOTION_DERIVED + 1], given[GIVEN];
  Sources sources = {signals, source, 1, EXOGENOUS, 1, bundles, 0};
  int outcome = COMPLETED;
  if (stride < 1 || stride > AHEAD) return -1;
  const int piece = AHEAD / stride * stride;
  const int64_t length = (samples + stride - 1) / stride;
  parameters_of(settings, parameters);
  start(parameters, &beginning, state);
  derive_motion(settings, for_motion);
  hold_back_from(state + QUEUE, (int)parameters[PARAMETERS - 1]);
  set_signals_up((uint64_t)seed_high << 32 | seed_low);
  prepare(&sources);
  for (stepped = 0; stepped < samples && outcome == COMPLETED;) {
    const int64_t n = samples - stepped < piece ? samples - stepped : piece;
    int64_t done;
    fill(&sources, stepped, n, table);
    for (int64_t k = 0; k < n; ++k) {
      const double t = (double)(stepped + k) * settings[SAMPLE_TIME];
      motion(&t, settings, for_motion, given);
      for (int i = 0; i < GIVEN; ++i) table[k * EXOGENOUS + given_at_index[i]] = given[i];
    }
    outcome = rollout(parameters, table, state, n, stride, columns ? rows : 0, &done);
    if (columns) put_rows(stepped / stride, (done + stride - 1) / stride, columns, length);
    stepped += done;
  }
  figures(state, metrics);
  idealised(settings, checks);
  return outcome;
}
