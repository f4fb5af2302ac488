/* White and Gauss-Markov signals in vector lanes. Comes after elementary.h, normal.h and sources.h. To be compiled without
   contraction. */

enum { PIECE = 32 }; /* largest number of samples drawn at a time */

/* Numbers of WIDE lanes. */
typedef double Doubles __attribute__((vector_size(WIDE * sizeof(double))));
typedef float Floats __attribute__((vector_size(WIDE * sizeof(float))));

/* The signals' states driven by white noise, times their standard deviations; (samples, WIDTH). */
static void filter(Bundle *bundle, int64_t first, int64_t samples, const Floats *restrict noise, Doubles *restrict values) {
  Doubles decay[VECTORS], fresh[VECTORS], sigma[VECTORS], start[VECTORS], state[VECTORS];
  memcpy(decay, bundle->decay, sizeof decay);
  memcpy(fresh, bundle->fresh, sizeof fresh);
  memcpy(sigma, bundle->sigma, sizeof sigma);
  memcpy(start, bundle->start, sizeof start);
  memcpy(state, bundle->state, sizeof state);
  for (int64_t k = 0; k < samples; ++k)
    for (int v = 0; v < VECTORS; ++v) {
      const Doubles drawn = __builtin_convertvector(noise[k * VECTORS + v], Doubles);
      state[v] = first + k ? decay[v] * state[v] + fresh[v] * drawn : start[v] * drawn;
      values[k * VECTORS + v] = sigma[v] * state[v];
    }
  memcpy(bundle->state, state, sizeof state);
  for (int l = 0; l < bundle->count; ++l) bundle->signals[l]->state = bundle->state[l];
}

/* White noise of each signal's kind, in whole blocks from block `first` on. */
static void draw_blocks(const Bundle *bundle, int64_t first, int64_t blocks, float *restrict noise) {
  uint32_t words[BLOCK * WIDTH];
  for (int64_t block = first; block < first + blocks; ++block, noise += BLOCK * WIDTH) {
    draw_words(&bundle->keys, bundle->stream, (uint64_t)block, words);
    draw_normals(words, noise);
    for (int l = 0; bundle->uniform && l < bundle->count; ++l)
      if (bundle->signals[l]->kind == UNIFORM)
        for (int w = 0; w < BLOCK; ++w) noise[w * WIDTH + l] = uniform(words[w * WIDTH + l]);
  }
}

/* Writes one sample's values to the rows of the table. */
static inline void hand_out(const Bundle *bundle, const double *restrict values, double *restrict line, const int64_t lanes) {
  for (int r = 0; r < bundle->rows; ++r) {
    double *restrict row = line + bundle->row[r] * lanes;
    const int *from = bundle->from[r];
    if (bundle->adds[r]) for (int64_t l = 0; l < lanes; ++l) row[l] += values[from[l]];
    else if (bundle->whole) for (int64_t l = 0; l < lanes; ++l) row[l] = values[l];
    else for (int64_t l = 0; l < lanes; ++l) row[l] = values[from[l]];
  }
}

/* Draws signals and writes them to the table. */
static void put_drawn(Bundle *bundle, int64_t first, int64_t samples, double *table, int64_t count, int64_t lanes) {
  Floats noise[(PIECE + 2 * BLOCK) * VECTORS];
  Doubles filtered[PIECE * VECTORS];
  double limit[WIDTH], values[WIDTH + 1] = {0};
  const int64_t block = first / BLOCK;
  draw_blocks(bundle, block, (first + samples + BLOCK - 1) / BLOCK - block, (float *)noise);
  filter(bundle, first, samples, noise + (first - block * BLOCK) * VECTORS, filtered);
  memcpy(limit, bundle->limit, sizeof limit);
  for (int64_t k = 0; k < samples; ++k, table += count * lanes) {
    const double *restrict unlimited = (const double *)(filtered + k * VECTORS);
    for (int l = 0; l < WIDTH; ++l) values[l] = limited(unlimited[l], -limit[l], limit[l]);
    if (lanes == WIDTH) hand_out(bundle, values, table, WIDTH);
    else hand_out(bundle, values, table, lanes);
  }
}
