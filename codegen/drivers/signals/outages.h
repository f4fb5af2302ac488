/* Outages, each from one block of random words. Comes after sources.h. */

/* A uniform integer from 0 to count - 1; count is below 2^32. */
static inline int64_t below(int64_t count, uint64_t word) { return (int64_t)((uint64_t)count * (uint32_t)word >> 32); }

/* Adds a signal's outages in the lanes of its source. Length and start of the outage in window k are drawn from block k. */
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
