/* Signals sample by sample, given or random. Comes after elementary.h and normal.h. To be compiled without contraction. */

/* What a signal's random part is: none; a first-order Gauss-Markov signal within limits, white noise
   where decay is 0; white noise uniform in [-1, 1]; 1 in outages, else 0. */
enum { NOTHING = 0, NORMAL = 1, UNIFORM = 2, OUTAGES = 3 };

typedef struct {
  const double *given; /* of the samples from given_from on; null: zero */
  int64_t given_from;
  int64_t kind; /* of the random part */
  uint64_t seed, stream;
  double sigma; /* standard deviation */
  double decay; /* from sample to sample */
  double limit; /* of the random part's magnitude */
  double state; /* standardised, of the last sample that was filled */
  int64_t period, length; /* samples of a window, which has one outage, and of an outage on average */
  int64_t from_zero;      /* whether it is zero before sample 0; else it is stationary */
} Signal;

enum { PIECE = 32 }; /* samples that are filled at a time, at most */

/* White and Gauss-Markov signals side by side in WIDTH lanes, of some signals those of all sources; and the rows of a
   line that receive them: lane l of row r what element `from[r][l]` holds, the one beyond the last nothing. */
typedef struct {
  uint64_t seed[WIDTH], stream[WIDTH];
  double decay[WIDTH], fresh[WIDTH], sigma[WIDTH], limit[WIDTH], start[WIDTH], state[WIDTH];
  Signal *signals[WIDTH];
  int count, uniform; /* how many; whether some are */
  int rows, row[WIDTH], adds[WIDTH], from[WIDTH][WIDTH]; /* `adds`: to what is there */
  int whole; /* whether a row receives all, lane by lane */
} Side;

/* What runs in lanes receive, each from one of some sources. */
typedef struct {
  Signal *signals;       /* (sources, count) */
  const int64_t *source; /* (lanes,) which source a lane has; at most WIDTH lanes */
  int64_t sources, count, lanes;
  Side *sides;   /* room for `count` of them */
  int64_t drawn; /* how many of them there are */
} Sources;

EXPORT const int64_t side_size = sizeof(Side);

static inline const double *given_at(const Signal *signal, int64_t sample) {
  return signal->given ? signal->given + (sample - signal->given_from) : 0;
}

/* What is given of a signal; lanes whose sources have it from the same place all receive it at once. */
static inline void give(const Sources *sources, int64_t i, int64_t first, int64_t samples, double *restrict out,
                        const int64_t lanes) {
  const int64_t line = sources->count * lanes;
  const Signal *signals = sources->signals + i;
  const double *given = given_at(signals, first);
  int shared = 1;
  for (int64_t s = 1; s < sources->sources; ++s) shared &= given_at(signals + s * sources->count, first) == given;
  if (shared) {
    for (int64_t k = 0; k < samples; ++k) {
      const double value = given ? given[k] : 0.0;
      for (int64_t l = 0; l < lanes; ++l) out[k * line + l] = value;
    }
    return;
  }
  for (int64_t l = 0; l < lanes; ++l) {
    given = given_at(signals + sources->source[l] * sources->count, first);
    for (int64_t k = 0; k < samples; ++k) out[k * line + l] = given ? given[k] : 0.0;
  }
}

/* One of so many numbers from 0 on, all as likely; fewer than 2^32. */
static inline int64_t below(int64_t count, uint64_t word) { return (int64_t)((uint64_t)count * (uint32_t)word >> 32); }

/* Adds a signal's outages where its source's lanes are. Window k has its outage's length and beginning from the words of
   block k. */
static void add_outages(const Sources *sources, int64_t s, int64_t i, int64_t first, int64_t samples, double *out) {
  const Signal *signal = sources->signals + s * sources->count + i;
  const int64_t period = signal->period, half = signal->length / 2, line = sources->count * sources->lanes;
  for (int64_t k = first; k < first + samples;) {
    const int64_t window = k / period, start = window * period;
    const Block block = block_of(signal->seed, signal->stream, (uint64_t)window);
    int64_t length = signal->length - half + below(2 * half + 1, block.a);
    if (length > period) length = period;
    const int64_t begin = start + below(period - length + 1, block.b);
    for (; k < first + samples && k < start + period; ++k)
      if (k >= begin && k < begin + length)
        for (int64_t l = 0; l < sources->lanes; ++l)
          if (sources->source[l] == s) out[(k - first) * line + l] += 1.0;
  }
}

/* Numbers of some lanes, in vectors that processors or compilers take to pieces where they are too wide. */
enum { WIDE = 8, VECTORS = WIDTH / WIDE };
typedef double Doubles __attribute__((vector_size(WIDE * sizeof(double))));
typedef float Floats __attribute__((vector_size(WIDE * sizeof(float))));

static void take_up(Side *side, Signal *signal) {
  const int at = side->count++, normal = signal->kind == NORMAL;
  side->signals[at] = signal;
  side->uniform |= !normal;
  side->seed[at] = signal->seed;
  side->stream[at] = signal->stream;
  side->decay[at] = normal ? signal->decay : 0.0;
  side->fresh[at] = sqrt(1.0 - side->decay[at] * side->decay[at]);
  side->sigma[at] = normal ? signal->sigma : 1.0;
  side->limit[at] = normal ? signal->limit : 1.0;
  side->start[at] = normal && signal->from_zero ? side->fresh[at] : 1.0;
  side->state[at] = signal->state;
}

/* Whether something stands in a signal's rows before what is white or Gauss-Markov is added. */
static int starts_empty(const Sources *sources, int64_t i) {
  for (int64_t s = 0; s < sources->sources; ++s) {
    const Signal *signal = sources->signals + s * sources->count + i;
    if (signal->given || signal->kind == OUTAGES) return 0;
  }
  return 1;
}

/* Puts white and Gauss-Markov signals side by side; to be done before `fill`. */
EXPORT void prepare(Sources *sources) {
  sources->drawn = 0;
  for (int64_t i = 0; i < sources->count; ++i) {
    int at[WIDTH], taken = 0; /* where each source's stands, counted from the first */
    for (int64_t s = 0; s < sources->sources; ++s) {
      const int64_t kind = sources->signals[s * sources->count + i].kind;
      at[s] = kind == NORMAL || kind == UNIFORM ? taken++ : -1;
    }
    if (!taken) continue;
    Side *side = sources->drawn ? sources->sides + (sources->drawn - 1) : 0;
    if (!side || side->count + taken > WIDTH) {
      side = sources->sides + sources->drawn++;
      memset(side, 0, sizeof *side);
    }
    const int first = side->count, row = side->rows++;
    side->row[row] = (int)i;
    side->adds[row] = !starts_empty(sources, i);
    for (int64_t s = 0; s < sources->sources; ++s)
      if (at[s] >= 0) take_up(side, sources->signals + s * sources->count + i);
    for (int64_t l = 0; l < sources->lanes; ++l)
      side->from[row][l] = at[sources->source[l]] < 0 ? WIDTH : first + at[sources->source[l]];
    side->whole = sources->lanes == WIDTH;
    for (int64_t l = 0; l < sources->lanes; ++l) side->whole &= side->from[row][l] == l;
  }
}

/* What white noise makes of the signals' states, sample by sample, times their standard deviations; (samples, WIDTH). */
static void filter(Side *side, int64_t first, int64_t samples, const Floats *restrict noise, Doubles *restrict values) {
  Doubles decay[VECTORS], fresh[VECTORS], sigma[VECTORS], start[VECTORS], state[VECTORS];
  memcpy(decay, side->decay, sizeof decay);
  memcpy(fresh, side->fresh, sizeof fresh);
  memcpy(sigma, side->sigma, sizeof sigma);
  memcpy(start, side->start, sizeof start);
  memcpy(state, side->state, sizeof state);
  for (int64_t k = 0; k < samples; ++k)
    for (int v = 0; v < VECTORS; ++v) {
      const Doubles drawn = __builtin_convertvector(noise[k * VECTORS + v], Doubles);
      state[v] = first + k ? decay[v] * state[v] + fresh[v] * drawn : start[v] * drawn;
      values[k * VECTORS + v] = sigma[v] * state[v];
    }
  memcpy(side->state, state, sizeof state);
  for (int l = 0; l < side->count; ++l) side->signals[l]->state = side->state[l];
}

/* White noise of each signal's kind, whole blocks of it from block `first` on. */
static void draw_blocks(const Side *side, int64_t first, int64_t blocks, float *restrict noise) {
  uint32_t words[BLOCK * WIDTH];
  for (int64_t block = first; block < first + blocks; ++block, noise += BLOCK * WIDTH) {
    draw_words(side->seed, side->stream, (uint64_t)block, words);
    draw_normals(words, noise);
    for (int l = 0; side->uniform && l < side->count; ++l)
      if (side->signals[l]->kind == UNIFORM)
        for (int w = 0; w < BLOCK; ++w) noise[w * WIDTH + l] = uniform(words[w * WIDTH + l]);
  }
}

/* Puts one sample's values where they are received. */
static inline void hand_out(const Side *side, const double *restrict values, double *restrict line, const int64_t lanes) {
  for (int r = 0; r < side->rows; ++r) {
    double *restrict row = line + side->row[r] * lanes;
    const int *from = side->from[r];
    if (side->adds[r]) for (int64_t l = 0; l < lanes; ++l) row[l] += values[from[l]];
    else if (side->whole) for (int64_t l = 0; l < lanes; ++l) row[l] = values[l];
    else for (int64_t l = 0; l < lanes; ++l) row[l] = values[from[l]];
  }
}

/* Draws signals and puts them where they are received. */
static void put_drawn(Side *side, int64_t first, int64_t samples, double *table, int64_t count, int64_t lanes) {
  Floats noise[(PIECE + 2 * BLOCK) * VECTORS];
  Doubles filtered[PIECE * VECTORS];
  double limit[WIDTH], values[WIDTH + 1] = {0};
  const int64_t block = first / BLOCK;
  draw_blocks(side, block, (first + samples + BLOCK - 1) / BLOCK - block, (float *)noise);
  filter(side, first, samples, noise + (first - block * BLOCK) * VECTORS, filtered);
  memcpy(limit, side->limit, sizeof limit);
  for (int64_t k = 0; k < samples; ++k, table += count * lanes) {
    memcpy(values, filtered + k * VECTORS, WIDTH * sizeof *values);
    for (int l = 0; l < WIDTH; ++l) values[l] = limited(values[l], -limit[l], limit[l]);
    if (lanes == WIDTH) hand_out(side, values, table, WIDTH);
    else hand_out(side, values, table, lanes);
  }
}

/* Whether what is drawn is all that a signal's row holds. */
static int is_drawn(const Sources *sources, int64_t i) {
  for (const Side *side = sources->sides; side < sources->sides + sources->drawn; ++side)
    for (int r = 0; r < side->rows; ++r)
      if (side->row[r] == i) return !side->adds[r];
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
    for (Side *side = sources->sides; side < sources->sides + sources->drawn; ++side)
      put_drawn(side, from, n, table, count, lanes);
  }
}
