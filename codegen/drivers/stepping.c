/* Steps runs of a sampled system by a few samples per call, under external commands; a block consists of LANES runs.
   Comes after driver.h, lanes.h, the sizes, the functions of codegen/sampled.py with derive(parameters, derived),
   sampled_lanes.h, and sense(state, exogenous, parameters, derived, observation), over arrays of stride LANES.
   READ_EXOGENOUS lists the exogenous signals in use. Commands are elements of the state: COMMAND_OF lists commands,
   COMMANDED_STATES the states that they set.

   The result of a run depends on its own numbers alone. An ended run does not change. */

/* Values derived from a block's parameters, constant over all samples. */
typedef struct {
  LANE_ARRAY p[PARAMETERS * LANES], derived[(DERIVED + 1) * LANES];
} Constants;

EXPORT const int64_t constants_size = sizeof(Constants) / sizeof(double);

/* All runs, run number b * LANES + l in lane l of block b. Beyond the last run, lanes are idle. */
typedef struct {
  const Constants *constants; /* (blocks,), or (1,) if all runs have the same */
  int64_t apart;              /* stride of the constants: 1, or 0 if all blocks share them */
  const double **lines;       /* (blocks, LANES) each run's exogenous signals of its next sample; one line beyond is read */
  double *state;              /* (blocks, STATES, LANES) */
  int64_t *outcome, *done;    /* (blocks, LANES) */
  const double *commands;     /* (runs, COMMANDS) */
  double *observation;        /* (OBSERVED, runs) */
  int64_t runs, samples;      /* number of runs; samples of a whole run */
} Runs;

EXPORT void prepare(const double *parameters, Constants *constants) {
  EACH_LANE for (int i = 0; i < PARAMETERS; ++i) constants->p[i * LANES + l] = parameters[l * PARAMETERS + i];
  derive_lanes(constants->p, constants->derived);
}

IN_LANES observe_lanes(const double *restrict state, const double *restrict exogenous, const double *restrict p,
                       const double *restrict derived, double *restrict row) {
  EACH_CALL observe(state + l, exogenous + l, p + l, derived + l, row + l);
}

IN_LANES sense_lanes(const double *restrict state, const double *restrict exogenous, const double *restrict p,
                     const double *restrict derived, double *restrict observation) {
  EACH_CALL sense(state + l, exogenous + l, p + l, derived + l, observation + l);
}

/* The state at the next sample, by the one-step update or by all parts of the sample interval. */
static void advance(const double *now, const double *w, const double *live, const Constants *constants, double *next,
                    double *margin) {
  LANE_ARRAY hold[HOLD * LANES];
#if HAS_ONE_STEP
  LANE_ARRAY valid[LANES], moved[MOTION * LANES], moved_margin[LANES], missing[LANES];
  SAMPLE_BY_PHASE(now, w, constants->p, constants->derived, next + MOTION * LANES, hold, next, margin, valid);
  int any = 0;
  EACH_LANE {
    missing[l] = !(valid[l] > 0) && live[l] > 0;
    any += missing[l] > 0;
  }
  if (any) {
    move_on(missing, now, hold, constants->p, constants->derived, moved, moved_margin);
    take_over(missing, next, moved, MOTION);
    take_over(missing, margin, moved_margin, 1);
  }
#else
  SAMPLE_BY_PHASE(now, w, constants->p, constants->derived, next + MOTION * LANES, hold);
  move_on(live, now, hold, constants->p, constants->derived, next, margin);
#endif
}

/* The signals of all lanes, which may share one line. */
static void gather(const double *const *lines, double *restrict w) {
  static const int read[] = READ_EXOGENOUS;
  const int count = sizeof read / sizeof *read;
  int shared = 1;
  EACH_LANE shared &= lines[l] == lines[0];
  for (int i = 0; i < count; ++i) {
    double *restrict to = w + read[i] * LANES;
    if (shared) {
      const double value = lines[0][read[i]];
      EACH_LANE to[l] = value;
    } else {
      EACH_LANE to[l] = lines[l][read[i]];
    }
  }
}

static void command(const Runs *runs, int64_t block, double *now) {
  static const int of[] = COMMAND_OF, states[] = COMMANDED_STATES;
  const double *commands = runs->commands + block * LANES * COMMANDS;
  EACH_LANE {
    if (runs->outcome[block * LANES + l] != RUNNING) continue;
    for (int i = 0; i < (int)(sizeof of / sizeof *of); ++i) now[states[i] * LANES + l] = commands[l * COMMANDS + of[i]];
  }
}

/* Observes the runs of a block; a diverged run keeps its last observation. */
static void look_at(const Runs *runs, int64_t block) {
  const Constants *constants = runs->constants + block * runs->apart;
  const int64_t first = block * LANES, *outcome = runs->outcome + first;
  LANE_ARRAY w[EXOGENOUS * LANES], observed[OBSERVED * LANES];
  gather(runs->lines + first, w);
  sense_lanes(runs->state + first * STATES, w, constants->p, constants->derived, observed);
  const int64_t busy = runs->runs - first < LANES ? runs->runs - first : LANES;
  for (int i = 0; i < OBSERVED; ++i)
    for (int64_t l = 0; l < busy; ++l)
      if (outcome[l] != DIVERGED) runs->observation[i * runs->runs + first + l] = observed[i * LANES + l];
}

/* Steps a block; returns the number of runs still running. */
static int step_block(const Runs *runs, int64_t block, int64_t samples, double *row) {
  const Constants *constants = runs->constants + block * runs->apart;
  const double **lines = runs->lines + block * LANES;
  int64_t *outcome = runs->outcome + block * LANES, *done = runs->done + block * LANES;
  double *now = runs->state + block * LANES * STATES;
  LANE_ARRAY next[STATES * LANES], w[EXOGENOUS * LANES], margin[LANES], live[LANES], kept[COLUMNS * LANES];
  uint64_t finite[LANES];
  int running = 0;
  EACH_LANE {
    live[l] = outcome[l] == RUNNING;
    running += outcome[l] == RUNNING;
  }
  if (!running) return 0;
  command(runs, block, now);
  for (int64_t k = 0; k < samples && running; ++k) {
    gather(lines, w);
    if (row) {
      observe_lanes(now, w, constants->p, constants->derived, kept);
      for (int i = 0; i < COLUMNS; ++i) *row++ = kept[i * LANES];
    }
    advance(now, w, live, constants, next, margin);
    find_finite(next, finite);
    if (running == LANES) memcpy(now, next, sizeof next);
    else take_over(live, now, next, STATES);
    running = 0;
    EACH_LANE {
      if (outcome[l] != RUNNING) continue;
      lines[l] += EXOGENOUS;
      if (++done[l] == runs->samples) outcome[l] = COMPLETED;
      if (!finite[l]) outcome[l] = DIVERGED;
      else if (margin[l] < 0) outcome[l] = LEFT;
      live[l] = outcome[l] == RUNNING;
      running += outcome[l] == RUNNING;
    }
  }
  look_at(runs, block);
  return running;
}

/* Observes the blocks from first to before last. */
EXPORT void look(const Runs *runs, int64_t first, int64_t last) {
  for (int64_t block = first; block < last; ++block) look_at(runs, block);
}

/* The first command of a running run that is not finite, or -1. */
EXPORT int64_t odd_command(const Runs *runs) {
  for (int64_t run = 0; run < runs->runs; ++run) {
    if (runs->outcome[run] != RUNNING) continue;
    if (!all_finite(runs->commands + run * COMMANDS, COMMANDS))
      for (int i = 0; i < COMMANDS; ++i)
        if (!all_finite(runs->commands + run * COMMANDS + i, 1)) return run * COMMANDS + i;
  }
  return -1;
}

/* Steps the blocks from first to before last by `samples` samples, fewer where runs end, with constant commands. Each
   sample of a block's first run writes a row, unless row is null. Returns the number of runs still running. */
EXPORT int64_t step(const Runs *runs, int64_t first, int64_t last, int64_t samples, double *row) {
  int64_t running = 0;
  for (int64_t block = first; block < last; ++block) running += step_block(runs, block, samples, row);
  return running;
}
