/* Applies a function to its own result ROUNDS times, for many points. Comes after driver.h, the sizes STATE, CONSTANT
   and ROUNDS, and ROUND(state, constant, number, next). */

/* state, result (count, STATE); constant (count, CONSTANT). The number of a round counts from 0. */
EXPORT void repeated(const double *state, const double *constant, double *result, int64_t count) {
  double buffers[2][STATE];
  for (int64_t k = 0; k < count; ++k) {
    memcpy(buffers[0], state + k * STATE, sizeof buffers[0]);
    for (int r = 0; r < ROUNDS; ++r) {
      const double number = r;
      ROUND(buffers[r % 2], constant + k * CONSTANT, &number, buffers[(r + 1) % 2]);
    }
    memcpy(result + k * STATE, buffers[ROUNDS % 2], sizeof buffers[0]);
  }
}
