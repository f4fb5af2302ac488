/* An extended Kalman filter: the gains of every sample from covariances. NaN is a missing reading.
   Comes after linear.h. */

enum { GAINS = READINGS * STATES, WHITENING = READINGS * READINGS };

/* Covariance (STATES × COLUMNS) of the next state: A covariance A' + walk, the diagonal of Q. */
static void spread(double *covariance, const Slopes *slopes, const double *walk) {
  LANE_ARRAY carried[STATES * COLUMNS], across[STATES * COLUMNS];
  carry(slopes, covariance, carried);
  memset(across, 0, sizeof across);
  for (int i = 0; i < STATES; ++i)
    for (int j = 0; j < STATES; ++j) across[j * COLUMNS + i] = carried[i * COLUMNS + j];
  carry(slopes, across, covariance);
  for (int i = 0; i < STATES; ++i) {
    for (int j = 0; j < i; ++j) covariance[j * COLUMNS + i] = covariance[i * COLUMNS + j];
    covariance[i * COLUMNS + i] += walk[i];
  }
}

/* Gains of a sample, by sequential updates with one sensor after the other.
   innovation: readings less their predictions; h (READINGS × COLUMNS): slopes of the readings by the state. Row i of
   whitening refers to the whole innovation, independent of the order of the sensors; row i of gains is the correction of
   the state per innovation i; rows of absent readings are not written. Both may be null, which saves time.
   corrected (STATES): the sum of all corrections. updates (READINGS × 2, null or NaN without a reading): what is left of
   each innovation after those of the sensors before it, and its variance.
   sums (4 each): number of readings, squares of whitened innovations, logarithms of their variances, and expected squares
   of the sensor's own noise. */
static void measurement_update(double *covariance, const double *innovation, const double *h, const double *variances,
                         double outlier, double *gains, double *whitening, double *updates, double *corrected,
                         double *sums) {
  LANE_ARRAY along[COLUMNS], column[COLUMNS];
  memset(corrected, 0, STATES * sizeof *corrected);
  for (int i = 0; i < READINGS; ++i) {
    if (absent(innovation[i])) continue;
    const double *slope = h + i * COLUMNS;
    double own[READINGS] = {0}; /* the remaining innovation, by all innovations */
    double variance = variances[i], left = innovation[i];
    int by[STATES + 1], count = 0; /* the states that the reading depends on */
    for (int k = 0; k < STATES; ++k) by[count] = k, count += slope[k] != 0;
    memset(along, 0, sizeof along);
    for (int n = 0; n < count; ++n) add_row(along, slope[by[n]], covariance + by[n] * COLUMNS);
    own[i] = 1;
    for (int n = 0; n < count; ++n) {
      const int k = by[n];
      variance += slope[k] * along[k], left -= slope[k] * corrected[k];
      for (int j = 0; gains && j < i; ++j)
        if (!absent(innovation[j])) own[j] -= slope[k] * gains[j * STATES + k];
    }
    const double square = left * left / variance;
    const double weight = square > outlier * outlier ? outlier / sqrt(square) : 1;
    memset(column, 0, sizeof column);
    add_row(column, weight / variance, along);
    for (int k = 0; k < STATES; ++k) add_row(covariance + k * COLUMNS, -column[k], along);
    add(corrected, left, column, STATES);
    if (gains) {
      const double white = sqrt(weight) / sqrt(variance);
      for (int j = 0; j < READINGS; ++j) whitening[i * READINGS + j] = white * own[j];
      memcpy(gains + i * STATES, column, STATES * sizeof *gains);
      for (int j = 0; j < i; ++j)
        if (!absent(innovation[j])) add(gains + j * STATES, own[j], column, STATES);
    }
    const double kept = variances[i] / variance; /* share of the innovation that remains after the correction */
    if (updates) updates[2 * i] = left, updates[2 * i + 1] = variance;
    sums[4 * i] += 1, sums[4 * i + 1] += weight * square, sums[4 * i + 2] += log(variance);
    sums[4 * i + 3] += weight * square * kept * variances[i] + (1 - kept) * variances[i];
  }
}

/* The gains of every sample: gains (samples × READINGS × STATES), whitening (samples × READINGS²); rows of absent readings
   are unchanged; both may be null.
   start (STATES), first_covariance (STATES²): mean and covariance before the first sample; walk (STATES): variances added
   by a sample; variances (READINGS) of the sensors' noise; outlier: innovation over its deviation above which a reading is
   downweighted (Huber). sums (4 per sensor) is overwritten. states and deviations (samples × STATES), mean and standard
   deviation after each sample's readings, covariances (samples × watched × STATES), the rows of the last `watched` states
   then, updates (samples × READINGS × 2), as of `measurement_update`, and end and end_covariance, mean and covariance
   before a next sample, may be null.
   Returns the outcome: a mean that is not finite or leaves the track ends the filter; *done: samples processed. */
EXPORT int filter(const double *parameters, const double *inputs, const double *readings, int64_t samples,
                 const double *start, const double *first_covariance, const double *walk, const double *variances,
                 double outlier, double *gains, double *whitening, double *sums, double *states, double *deviations,
                 int64_t watched, double *covariances, double *updates, double *end, double *end_covariance,
                 int64_t *done) {
  double derived[DERIVED + 1];
  Slopes slopes;
  double state[STATES], next[STATES], corrected[STATES], expected[READINGS], innovation[READINGS], margin = 0;
  double by_state[LINEAR_SENSE_SLOPES + 1];
  LANE_ARRAY covariance[STATES * COLUMNS], h[READINGS * COLUMNS], identity[STATES * COLUMNS];
  put_identity(identity);
  derive(parameters, derived);
  memcpy(state, start, sizeof state);
  memset(sums, 0, 4 * READINGS * sizeof *sums);
  memset(covariance, 0, sizeof covariance);
  for (int i = 0; i < STATES; ++i)
    memcpy(covariance + i * COLUMNS, first_covariance + i * STATES, STATES * sizeof *covariance);
  for (int64_t k = 0; k < samples; ++k) {
    linear_sense(state, inputs, parameters, derived, expected, by_state);
    sense_columns(by_state, identity, h);
    for (int i = 0; i < READINGS; ++i) innovation[i] = readings[i] - expected[i];
    measurement_update(covariance, innovation, h, variances, outlier, gains ? gains + k * GAINS : NULL,
                       gains ? whitening + k * WHITENING : NULL, updates, corrected, sums);
    if (updates) updates += 2 * READINGS;
    for (int i = 0; i < STATES; ++i) state[i] += corrected[i];
    if (states) {
      memcpy(states, state, sizeof state), states += STATES;
      for (int i = 0; i < STATES; ++i) *deviations++ = sqrt(covariance[i * COLUMNS + i]);
    }
    for (int64_t i = STATES - watched; covariances && i < STATES; ++i)
      memcpy(covariances, covariance + i * COLUMNS, STATES * sizeof *covariances), covariances += STATES;
    linearise(state, inputs, parameters, derived, next, &margin, &slopes);
    memcpy(state, next, sizeof state);
    spread(covariance, &slopes, walk);
    *done = k + 1;
    if (!all_finite(state, STATES) || !all_finite(covariance, STATES * COLUMNS)) return DIVERGED;
    if (margin < 0) return LEFT;
    inputs += INPUTS, readings += READINGS;
  }
  if (end) memcpy(end, state, sizeof state);
  for (int i = 0; end_covariance && i < STATES; ++i)
    memcpy(end_covariance + i * STATES, covariance + i * COLUMNS, STATES * sizeof *covariance);
  return COMPLETED;
}
