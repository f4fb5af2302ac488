/* Signals sample by sample, given or random. Comes after normal.h. To be compiled without contraction. */

/* What is given, and a first-order Gauss-Markov signal of a standard deviation within limits (white noise where decay is
   0), stationary from sample 0 on. */
typedef struct {
  const double *given; /* of the samples from given_from on; null: zero */
  int64_t given_from;
  uint64_t seed, stream;
  double sigma; /* 0: nothing random */
  double decay; /* from sample to sample */
  double limit; /* of the random part's magnitude */
  double state; /* standardised, of the last sample that was filled */
} Signal;

/* Sample `first + k` of signal i goes to table[k * count + i]. Signals with a decay are filled in the order of their
   samples. */
EXPORT void fill(Signal *signals, int64_t count, int64_t first, int64_t samples, double *table) {
  uint32_t words[GROUP];
  double normals[GROUP];
  for (int64_t from = first; from < first + samples;) {
    int64_t group = from / GROUP, start = group * GROUP, end = start + GROUP;
    if (end > first + samples) end = first + samples;
    for (int64_t i = 0; i < count; ++i) {
      Signal *signal = signals + i;
      const double *given = signal->given ? signal->given + (from - signal->given_from) : 0;
      double *out = table + (from - first) * count + i;
      if (signal->sigma == 0) {
        for (int64_t k = 0; k < end - from; ++k) out[k * count] = given ? given[k] : 0.0;
        continue;
      }
      draw_words(signal->seed, signal->stream, (uint64_t)group, words);
      draw_normals(words, normals);
      double *drawn = normals + (from - start), decay = signal->decay, sigma = signal->sigma, limit = signal->limit;
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
