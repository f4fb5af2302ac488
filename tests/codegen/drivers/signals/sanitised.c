/* Fills tables piece by piece with signals of all kinds, in one lane and in all, for builds with sanitizers. Output: the sum. */

#include <stdio.h>
#include <stdlib.h>

enum { SOURCES = 5, COUNT = 7, SAMPLES = 300 };

static double filled(int64_t lanes) {
  double *given = calloc(SAMPLES, sizeof *given), total = 0;
  Signal *signals = calloc(SOURCES * COUNT, sizeof *signals);
  Side *sides = malloc(COUNT * sizeof *sides);
  int64_t *source = calloc((size_t)lanes, sizeof *source);
  for (int64_t l = 0; l < lanes; ++l) source[l] = lanes == 1 ? 0 : l * 7 % SOURCES;
  for (int s = 0; s < SOURCES; ++s)
    for (int i = 0; i < COUNT; ++i)
      signals[s * COUNT + i] = (Signal){.given = (s + i) % 3 ? 0 : given, .kind = s == 3 ? NOTHING : i % 4,
                                        .seed = UINT64_MAX - (uint64_t)s, .stream = UINT64_MAX - (uint64_t)i,
                                        .sigma = 2, .decay = i / 10.0, .limit = 3, .period = 40 + 50 * i, .length = 9};
  Sources sources = {signals, source, lanes == 1 ? 1 : SOURCES, COUNT, lanes, sides, 0};
  prepare(&sources);
  for (int64_t first = 0, samples = 1; first < SAMPLES; first += samples, samples = samples % 67 * 3 + 1) {
    if (samples > SAMPLES - first) samples = SAMPLES - first;
    double *table = malloc((size_t)(samples * COUNT * lanes) * sizeof *table);
    fill(&sources, first, samples, table);
    for (int64_t k = 0; k < samples * COUNT * lanes; ++k) total += table[k];
    free(table);
  }
  free(source);
  free(sides);
  free(signals);
  free(given);
  return total;
}

int main(void) {
  printf("%.17g\n", filled(1) + filled(WIDTH));
  return 0;
}
