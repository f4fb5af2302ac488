/* Runs the rollout of the translation unit before it on data read from standard input, for builds with sanitizers.
   Input: samples (int64), then parameters, state, exogenous; output: outcome and samples stepped. */

#include <stdio.h>
#include <stdlib.h>

static double *numbers(size_t count) {
  double *values = malloc(count * sizeof *values);
  if (!values || fread(values, sizeof *values, count, stdin) != count) exit(3);
  return values;
}

int main(void) {
  int64_t samples, done = 0;
  if (fread(&samples, sizeof samples, 1, stdin) != 1) return 3;
  double *parameters = numbers(PARAMETERS), *state = numbers(STATES);
  double *exogenous = numbers((size_t)samples * EXOGENOUS);
  double *rows = malloc((size_t)(samples / 7 + 1) * COLUMNS * sizeof *rows);
  int outcome = rollout(parameters, exogenous, state, samples, 7, rows, &done);
  printf("%d %lld\n", outcome, (long long)done);
  free(parameters);
  free(state);
  free(exogenous);
  free(rows);
  return 0;
}
