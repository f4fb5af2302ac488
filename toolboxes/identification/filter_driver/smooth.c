/* Copies rows of STATES elements from a matrix of stride COLUMNS. */
static inline void take_columns(double *to, const double *from, int rows) {
  for (int i = 0; i < rows; ++i) memcpy(to + i * STATES, from + i * COLUMNS, STATES * sizeof *to);
}

/* The last `watched` states given all readings: the modified Bryson–Frazier smoother (Bierman, Factorization Methods for
   Discrete Sequential Estimation, 1977), a backward pass with the gains of `filter`.
   states (samples × STATES) and covariances (samples × watched × STATES) are results of `filter`. smoothed
   (samples × watched) and spreads, their covariances (samples × watched²), are overwritten. Otherwise as `filter`. Comes
   after kalman.c. */
EXPORT int smooth(const double *parameters, const double *inputs, const double *readings, int64_t samples,
                  const double *states, const double *gains, const double *whitening, int64_t watched,
                  const double *covariances, double *smoothed, double *spreads) {
  double derived[DERIVED + 1];
  Slopes slopes;
  double pull[STATES] = {0}, certainty[STATES * STATES] = {0}; /* adjoint state and its covariance, from later readings */
  double turned[STATES], product[STATES * STATES], kept[STATES * STATES], expected[READINGS], h[READINGS * STATES];
  double innovation[READINGS], white[READINGS], white_h[READINGS * STATES], moved[STATES], by_state[STATES * STATES];
  double margin, sense_by_state[LINEAR_SENSE_SLOPES + 1];
  LANE_ARRAY identity[STATES * COLUMNS], columns[STATES * COLUMNS], sensed[READINGS * COLUMNS];
  put_identity(identity);
  derive(parameters, derived);
  for (int64_t k = samples - 1; k >= 0; --k) {
    for (int64_t i = 0; i < watched; ++i) {
      const double *row = covariances + (k * watched + i) * STATES;
      double mean = states[k * STATES + STATES - watched + i];
      memset(turned, 0, sizeof turned);
      add_product(turned, row, STATES, certainty, 1, STATES, STATES);
      for (int j = 0; j < STATES; ++j) mean += row[j] * pull[j];
      smoothed[k * watched + i] = mean;
      for (int64_t other = 0; other < watched; ++other) {
        double spread = row[STATES - watched + other];
        for (int j = 0; j < STATES; ++j) spread -= turned[j] * covariances[(k * watched + other) * STATES + j];
        spreads[(k * watched + i) * watched + other] = spread;
      }
    }
    if (k == 0) break;
    linearise(states + (k - 1) * STATES, inputs + (k - 1) * INPUTS, parameters, derived, moved, &margin, &slopes);
    carry(&slopes, identity, columns);
    linear_sense(moved, inputs + k * INPUTS, parameters, derived, expected, sense_by_state);
    sense_columns(sense_by_state, identity, sensed);
    take_columns(by_state, columns, STATES);
    take_columns(h, sensed, READINGS);
    const double *gain = gains + k * GAINS, *by = whitening + k * WHITENING;
    for (int i = 0; i < READINGS; ++i) {
      const double read = readings[k * READINGS + i];
      innovation[i] = absent(read) ? 0 : read - expected[i];
    }
    memset(white, 0, sizeof white);
    memset(white_h, 0, sizeof white_h);
    add_product(white, by, READINGS, innovation, READINGS, READINGS, 1);
    add_product(white_h, by, READINGS, h, READINGS, READINGS, STATES);
    memset(kept, 0, sizeof kept); /* share of a state that remains after a correction: 1 - gain h */
    for (int i = 0; i < STATES; ++i) {
      kept[i * STATES + i] = 1;
      for (int r = 0; r < READINGS; ++r) add(kept + i * STATES, -gain[r * STATES + i], h + r * STATES, STATES);
    }
    /* before the correction, then before the move */
    memset(turned, 0, sizeof turned);
    add_product(turned, pull, STATES, kept, 1, STATES, STATES);
    add_product(turned, white, READINGS, white_h, 1, READINGS, STATES);
    memset(pull, 0, sizeof pull);
    add_product(pull, turned, STATES, by_state, 1, STATES, STATES);
    memset(product, 0, sizeof product);
    add_product(product, certainty, STATES, kept, STATES, STATES, STATES);
    memset(certainty, 0, sizeof certainty);
    for (int i = 0; i < STATES; ++i) /* kept' product + white_h' white_h */
      for (int j = 0; j < STATES; ++j) add(certainty + i * STATES, kept[j * STATES + i], product + j * STATES, STATES);
    for (int r = 0; r < READINGS; ++r)
      for (int i = 0; i < STATES; ++i) add(certainty + i * STATES, white_h[r * STATES + i], white_h + r * STATES, STATES);
    memset(product, 0, sizeof product);
    add_product(product, certainty, STATES, by_state, STATES, STATES, STATES);
    memset(certainty, 0, sizeof certainty);
    for (int i = 0; i < STATES; ++i)
      for (int j = 0; j < STATES; ++j)
        add(certainty + i * STATES, by_state[j * STATES + i], product + j * STATES, STATES);
    if (!all_finite(pull, STATES)) return DIVERGED;
  }
  return COMPLETED;
}
