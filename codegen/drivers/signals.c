/* Signals sample by sample, given or random. Comes after normal.h. To be compiled without contraction. */

/* What a signal's random part is: none; a first-order Gauss-Markov signal within limits, stationary from sample 0 on, white
   noise where decay is 0; white noise uniform in (-1, 1); 1 in outages, else 0. */
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
} Signal;

/* One of so many numbers from 0 on, all as likely; fewer than 2^32. */
static inline int64_t below(uint64_t count, uint32_t word) { return (int64_t)(count * word >> 32); }

/* Window k has its outage's length and beginning from words 0 and 1 of block k. */
static void draw_outages(const Signal *signal, int64_t first, int64_t samples, double *restrict drawn) {
  const int64_t period = signal->period, half = signal->length / 2;
  uint32_t words[GROUP];
  for (int64_t k = first; k < first + samples;) {
    const int64_t window = k / period, start = window * period;
    draw_words(signal->seed, signal->stream, (uint64_t)(window / BLOCKS), words);
    int64_t length = signal->length - half + below((uint64_t)(2 * half + 1), words[window % BLOCKS]);
    if (length > period) length = period;
    const int64_t begin = start + below((uint64_t)(period - length + 1), words[BLOCKS + window % BLOCKS]);
    for (; k < first + samples && k < start + period; ++k) drawn[k - first] = k >= begin && k < begin + length;
  }
}

static void draw_uniforms(const uint32_t *restrict words, double *restrict drawn) {
  for (int i = 0; i < GROUP; ++i) drawn[i] = uniform(words[i]);
}

/* Sample `first + k` of signal i goes to table[k * count + i]. Signals with a decay are filled in the order of their
   samples. */
EXPORT void fill(Signal *signals, int64_t count, int64_t first, int64_t samples, double *table) {
  uint32_t words[GROUP];
  double room[GROUP];
  for (int64_t from = first; from < first + samples;) {
    int64_t group = from / GROUP, start = group * GROUP, end = start + GROUP;
    if (end > first + samples) end = first + samples;
    for (int64_t i = 0; i < count; ++i) {
      Signal *signal = signals + i;
      const double *given = signal->given ? signal->given + (from - signal->given_from) : 0;
      double *out = table + (from - first) * count + i;
      if (signal->kind == NOTHING) {
        for (int64_t k = 0; k < end - from; ++k) out[k * count] = given ? given[k] : 0.0;
        continue;
      }
      double *drawn = room + (from - start);
      if (signal->kind == OUTAGES) {
        draw_outages(signal, from, end - from, drawn);
      } else {
        draw_words(signal->seed, signal->stream, (uint64_t)group, words);
        if (signal->kind == UNIFORM) draw_uniforms(words, room);
        else draw_normals(words, room);
      }
      if (signal->kind != NORMAL) {
        for (int64_t k = 0; k < end - from; ++k) out[k * count] = given ? given[k] + drawn[k] : drawn[k];
        continue;
      }
      double decay = signal->decay, sigma = signal->sigma, limit = signal->limit;
      if (decay != 0) {
        double state = signal->state, fresh = sqrt(1.0 - decay * decay);
        for (int64_t k = 0; k < end - from; ++k)
          drawn[k] = state = from + k > 0 ? decay * state + fresh * drawn[k] : drawn[k];
        signal->state = state;
      }
      for (int64_t k = 0; k < end - from; ++k) {
        double value = limited(sigma * drawn[k], -limit, limit);
        out[k * count] = given ? given[k] + value : value;
      }
    }
    from = end;
  }
}
