/* Signals sample by sample, given or random. Comes after outages.h and bundle.h. To be compiled without contraction. */

EXPORT const int64_t bundle_size = sizeof(Bundle);

static void take_up(Bundle *bundle, Signal *signal) {
  const int at = bundle->count++, normal = signal->kind == NORMAL;
  bundle->signals[at] = signal;
  bundle->uniform |= !normal;
  set_keys(&bundle->keys, at, signal->seed);
  bundle->stream[at] = signal->stream;
  bundle->decay[at] = normal ? signal->decay : 0.0;
  bundle->fresh[at] = sqrt(1.0 - bundle->decay[at] * bundle->decay[at]);
  bundle->sigma[at] = normal ? signal->sigma : 1.0;
  bundle->limit[at] = normal ? signal->limit : 1.0;
  bundle->start[at] = normal && signal->from_zero ? bundle->fresh[at] : 1.0;
  bundle->state[at] = signal->state;
}

/* Whether a signal's rows are empty before white or Gauss-Markov signals are added. */
static int starts_empty(const Sources *sources, int64_t i) {
  for (int64_t s = 0; s < sources->sources; ++s) {
    const Signal *signal = sources->signals + s * sources->count + i;
    if (signal->given || signal->kind == OUTAGES) return 0;
  }
  return 1;
}

/* Bundles white and Gauss-Markov signals; to be called before `fill`. */
EXPORT void prepare(Sources *sources) {
  sources->drawn = 0;
  for (int64_t i = 0; i < sources->count; ++i) {
    int at[WIDTH], taken = 0; /* position of each source's signal, counted from the first */
    for (int64_t s = 0; s < sources->sources; ++s) {
      const int64_t kind = sources->signals[s * sources->count + i].kind;
      at[s] = kind == NORMAL || kind == UNIFORM ? taken++ : -1;
    }
    if (!taken) continue;
    Bundle *bundle = sources->drawn ? sources->bundles + (sources->drawn - 1) : 0;
    if (!bundle || bundle->count + taken > WIDTH) {
      bundle = sources->bundles + sources->drawn++;
      memset(bundle, 0, sizeof *bundle);
    }
    const int first = bundle->count, row = bundle->rows++;
    bundle->row[row] = (int)i;
    bundle->adds[row] = !starts_empty(sources, i);
    for (int64_t s = 0; s < sources->sources; ++s)
      if (at[s] >= 0) take_up(bundle, sources->signals + s * sources->count + i);
    for (int64_t l = 0; l < sources->lanes; ++l)
      bundle->from[row][l] = at[sources->source[l]] < 0 ? WIDTH : first + at[sources->source[l]];
    bundle->whole = sources->lanes == WIDTH;
    for (int64_t l = 0; l < sources->lanes; ++l) bundle->whole &= bundle->from[row][l] == l;
  }
}

/* Whether a signal's row holds a drawn signal only. */
static int is_drawn(const Sources *sources, int64_t i) {
  for (const Bundle *bundle = sources->bundles; bundle < sources->bundles + sources->drawn; ++bundle)
    for (int r = 0; r < bundle->rows; ++r)
      if (bundle->row[r] == i) return !bundle->adds[r];
  return 0;
}

/* Fills a table (samples, count, lanes) with the samples from `first` on. Signals with a decay are filled in the order of
   their samples. */
EXPORT void fill(const Sources *sources, int64_t first, int64_t samples, double *table) {
  const int64_t lanes = sources->lanes, count = sources->count;
  for (int64_t from = first, n; from < first + samples; from += n, table += n * count * lanes) {
    n = first + samples - from < PIECE ? first + samples - from : PIECE;
    for (int64_t i = 0; i < count; ++i) {
      if (is_drawn(sources, i)) continue;
      if (lanes == WIDTH) give(sources, i, from, n, table + i * lanes, WIDTH);
      else give(sources, i, from, n, table + i * lanes, lanes);
      for (int64_t s = 0; s < sources->sources; ++s)
        if (sources->signals[s * count + i].kind == OUTAGES) add_outages(sources, s, i, from, n, table + i * lanes);
    }
    for (Bundle *bundle = sources->bundles; bundle < sources->bundles + sources->drawn; ++bundle)
      put_drawn(bundle, from, n, table, count, lanes);
  }
}
