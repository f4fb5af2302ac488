/* Solves recorded quadratic programs with OSQP's generated code, one after the other, warm-started, and says how long
   it took. Usage: program PROBLEMS REPETITIONS; linear terms, lower and upper bounds from stdin, solutions to stdout. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "osqp.h"
#include "qp_workspace.h"

int main(int count, char *words[]) {
  if (count != 3) return 2;
  const int problems = atoi(words[1]), repetitions = atoi(words[2]);
  const size_t size = (size_t)problems * 3 * N;
  double *given = malloc(size * sizeof *given), *found = malloc((size_t)problems * N * sizeof *found), best = 1e9;
  if (!given || !found || fread(given, sizeof *given, size, stdin) != size) return 1;
  for (int round = 0; round < repetitions; round++) {
    struct timespec begin, end;
    osqp_cold_start(&qp_solver);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &begin);
    for (int k = 0; k < problems; k++) {
      double *of = given + (size_t)k * 3 * N;
      osqp_update_data_vec(&qp_solver, of, of + N, of + 2 * N);
      osqp_solve(&qp_solver);
      for (int i = 0; i < N; i++) found[(size_t)k * N + i] = qp_solver.solution->x[i];
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &end);
    const double took = (double)(end.tv_sec - begin.tv_sec) + 1e-9 * (double)(end.tv_nsec - begin.tv_nsec);
    if (took < best) best = took;
  }
  fwrite(&best, sizeof best, 1, stdout);
  fwrite(found, sizeof *found, (size_t)problems * N, stdout);
  return 0;
}
