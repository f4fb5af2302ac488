/* Predicts the readings of a log, each sample's from all before it. Comes after driver.h, the sizes and the functions of
   codegen/predicted.py, each with its derive_NAME(parameters, derived).

   `weigh` is an extended Kalman filter: from covariances it gives the gains of every sample. `predict` goes through the log
   again with these gains as they are, and knows the exact slopes of what it expects by the FITTED numbers.
   Matrices lie row by row. A reading that is NaN is none. */

#include <math.h>

enum { GAINS = STATES * READINGS, WHITENING = READINGS * READINGS };

/* What follows from the parameters alone. */
typedef struct {
  double for_sense[SENSE_DERIVED + 1], for_prepare[PREPARE_DERIVED + 1], for_move[MOVE_DERIVED + 1],
      for_one_step[ONE_STEP_DERIVED + 1];
} Derived;

/* A state at the next sample, by that of this sample and by the fitted numbers. */
typedef struct {
  double state[STATES], by_state[STATES * STATES], by_fitted[STATES * FITTED + 1], margin;
} Moved;

static void derive(const double *parameters, Derived *derived) {
  derive_sense(parameters, derived->for_sense);
  derive_prepare(parameters, derived->for_prepare);
  derive_move(parameters, derived->for_move);
#if HAS_ONE_STEP
  derive_one_step(parameters, derived->for_one_step);
#endif
}

/* a += factor * b, `count` numbers */
static inline void add(double *restrict a, double factor, const double *restrict b, int count) {
  for (int i = 0; i < count; ++i) a[i] += factor * b[i];
}

/* out (rows × columns) += a (rows × inner) b (inner × columns) */
static inline void add_product(double *restrict out, const double *restrict a, const double *restrict b, int rows,
                               int inner, int columns) {
  for (int i = 0; i < rows; ++i)
    for (int k = 0; k < inner; ++k)
      if (a[i * inner + k] != 0) add(out + i * columns, a[i * inner + k], b + k * columns, columns);
}

static inline int absent(double reading) { return overflow(reading) >> 63; }

/* The state at the next sample: in one step where that is good enough, else part by part. */
static void advance(const double *state, const double *input, const double *parameters, const Derived *derived,
                    Moved *moved) {
  double hold[HOLD], hold_by_state[HOLD * STATES], hold_by_fitted[HOLD * FITTED + 1];
  double motion[MOTION], next[MOTION], by_motion[MOTION * MOTION], by_hold[MOTION * HOLD];
  double by_fitted[MOTION * FITTED + 1], valid = 0;
  double slopes[MOTION * STATES], turned[MOTION * STATES], fitted[MOTION * FITTED + 1], turned_fitted[MOTION * FITTED + 1];
  prepare(state, input, parameters, derived->for_prepare, moved->state + MOTION, hold, moved->by_state + MOTION * STATES,
          moved->by_fitted + MOTION * FITTED, hold_by_state, hold_by_fitted);
  memcpy(motion, state, sizeof motion);
  memset(slopes, 0, sizeof slopes);
  memset(fitted, 0, sizeof fitted);
  for (int i = 0; i < MOTION; ++i) slopes[i * STATES + i] = 1;
#if HAS_ONE_STEP
  one_step(motion, hold, parameters, derived->for_one_step, next, &moved->margin, &valid, by_motion, by_hold, by_fitted);
#endif
  for (int part = 0; part < (valid > 0 ? 1 : PARTS); ++part) {
    const double number = part;
    if (!(valid > 0))
      move(motion, hold, &number, parameters, derived->for_move, next, &moved->margin, by_motion, by_hold, by_fitted);
    memset(turned, 0, sizeof turned);
    memcpy(turned_fitted, by_fitted, MOTION * FITTED * sizeof *by_fitted);
    add_product(turned, by_motion, slopes, MOTION, MOTION, STATES);
    add_product(turned, by_hold, hold_by_state, MOTION, HOLD, STATES);
    add_product(turned_fitted, by_motion, fitted, MOTION, MOTION, FITTED);
    add_product(turned_fitted, by_hold, hold_by_fitted, MOTION, HOLD, FITTED);
    memcpy(slopes, turned, sizeof slopes);
    memcpy(fitted, turned_fitted, sizeof fitted);
    memcpy(motion, next, sizeof motion);
  }
  memcpy(moved->state, motion, sizeof motion);
  memcpy(moved->by_state, slopes, sizeof slopes);
  memcpy(moved->by_fitted, fitted, MOTION * FITTED * sizeof *fitted);
}

/* Covariance (STATES²) of the next state: A covariance A' + walk. */
static void spread(double *covariance, const double *a, const double *walk) {
  double carried[STATES * STATES];
  memset(carried, 0, sizeof carried);
  add_product(carried, a, covariance, STATES, STATES, STATES);
  for (int i = 0; i < STATES; ++i)
    for (int j = 0; j <= i; ++j) {
      double sum = i == j ? walk[i] : 0;
      for (int k = 0; k < STATES; ++k) sum += carried[i * STATES + k] * a[j * STATES + k];
      covariance[i * STATES + j] = covariance[j * STATES + i] = sum;
    }
}

/* Gains of a sample, one sensor after the other.
   surprise: readings less what was expected; h: slopes of the readings by the state. Both rows of whitening and gains are
   by the whole surprise, whatever the order of the sensors; sums (4 each): how many readings, the squares of whitened
   surprises, logarithms of their variances, and the squares that sensors' own noise would have. */
static void weigh_sample(double *covariance, const double *surprise, const double *h, const double *variances,
                         double outlier, double *gains, double *whitening, double *sums) {
  double along[STATES], alone[READINGS * READINGS] = {0}, corrected[STATES] = {0}, column[STATES];
  memset(gains, 0, GAINS * sizeof *gains);
  memset(whitening, 0, WHITENING * sizeof *whitening);
  for (int i = 0; i < READINGS; ++i) {
    if (absent(surprise[i])) continue;
    const double *slope = h + i * STATES;
    double *own = alone + i * READINGS, variance = variances[i], left = surprise[i];
    memset(along, 0, sizeof along);
    add_product(along, slope, covariance, 1, STATES, STATES);
    own[i] = 1; /* the surprise that is left of it, by all */
    for (int k = 0; k < STATES; ++k) {
      variance += slope[k] * along[k], left -= slope[k] * corrected[k];
      add(own, -slope[k], gains + k * READINGS, READINGS);
    }
    const double square = left * left / variance, deviation = sqrt(variance);
    const double weight = square > outlier * outlier ? outlier / sqrt(square) : 1;
    add(whitening + i * READINGS, sqrt(weight) / deviation, own, READINGS);
    for (int k = 0; k < STATES; ++k) {
      column[k] = weight * along[k] / variance;
      corrected[k] += column[k] * left;
      add(gains + k * READINGS, column[k], own, READINGS);
      add(covariance + k * STATES, -column[k], along, STATES);
    }
    const double kept = variances[i] / variance; /* share of the surprise that stays after the correction */
    sums[4 * i] += 1, sums[4 * i + 1] += weight * square, sums[4 * i + 2] += log(variance);
    sums[4 * i + 3] += weight * square * kept * variances[i] + (1 - kept) * variances[i];
  }
}

/* The gains of every sample: gains (samples × GAINS), whitening (samples × WHITENING).
   start (STATES), first_covariance (STATES²): what is expected before the first sample; walk (STATES): what a sample adds to
   its variances; variances (READINGS) of the sensors' noise; outlier: surprise over its deviation from which on a reading
   counts less (Huber). sums (4 a sensor) is overwritten. states and deviations (samples × STATES), what is expected after
   each sample's readings and how well it is known, and covariances (samples × watched × STATES), the rows of the last
   `watched` states then, may be null.
   Returns the outcome: an expectation that is not finite or leaves the track ends it; *done: samples gone through. */
EXPORT int weigh(const double *parameters, const double *inputs, const double *readings, int64_t samples,
                 const double *start, const double *first_covariance, const double *walk, const double *variances,
                 double outlier, double *gains, double *whitening, double *sums, double *states, double *deviations,
                 int64_t watched, double *covariances, int64_t *done) {
  Derived derived;
  Moved moved;
  double state[STATES], covariance[STATES * STATES], expected[READINGS], h[READINGS * STATES];
  double by_fitted[READINGS * FITTED + 1], surprise[READINGS];
  derive(parameters, &derived);
  memcpy(state, start, sizeof state);
  memset(sums, 0, 4 * READINGS * sizeof *sums);
  memcpy(covariance, first_covariance, sizeof covariance);
  for (int64_t k = 0; k < samples; ++k) {
    sense(state, inputs, parameters, derived.for_sense, expected, h, by_fitted);
    for (int i = 0; i < READINGS; ++i) surprise[i] = readings[i] - expected[i];
    weigh_sample(covariance, surprise, h, variances, outlier, gains, whitening, sums);
    for (int i = 0; i < READINGS; ++i)
      if (!absent(surprise[i]))
        for (int j = 0; j < STATES; ++j) state[j] += gains[j * READINGS + i] * surprise[i];
    if (states) {
      memcpy(states, state, sizeof state), states += STATES;
      for (int i = 0; i < STATES; ++i) *deviations++ = sqrt(covariance[i * STATES + i]);
    }
    if (covariances) {
      const double *rows = covariance + (STATES - watched) * STATES;
      memcpy(covariances, rows, watched * STATES * sizeof *rows), covariances += watched * STATES;
    }
    advance(state, inputs, parameters, &derived, &moved);
    memcpy(state, moved.state, sizeof state);
    spread(covariance, moved.by_state, walk);
    *done = k + 1;
    if (!all_finite(state, STATES) || !all_finite(covariance, STATES * STATES)) return DIVERGED;
    if (moved.margin < 0) return LEFT;
    inputs += INPUTS, readings += READINGS, gains += GAINS, whitening += WHITENING;
  }
  return COMPLETED;
}

/* Goes through the log with given gains. normal ((FITTED + 1)²), overwritten: sums over all readings of the products of the
   whitened surprises' slopes by the fitted numbers and, last, of the surprises themselves. surprises (samples × READINGS,
   whitened; NaN where nothing was read) may be null. Else as `weigh`. */
EXPORT int predict(const double *parameters, const double *inputs, const double *readings, int64_t samples,
                   const double *start, const double *gains, const double *whitening, double *normal,
                   double *surprises, int64_t *done) {
  enum { WIDTH = FITTED + 1 };
  Derived derived;
  Moved moved;
  double state[STATES], slopes[STATES * FITTED + 1] = {0}, expected[READINGS], h[READINGS * STATES];
  double by_fitted[READINGS * FITTED + 1], raw[READINGS * WIDTH], white[READINGS * WIDTH];
  derive(parameters, &derived);
  memcpy(state, start, sizeof state);
  memset(normal, 0, WIDTH * WIDTH * sizeof *normal);
  for (int64_t k = 0; k < samples; ++k) {
    sense(state, inputs, parameters, derived.for_sense, expected, h, by_fitted);
    memset(raw, 0, sizeof raw);
    for (int i = 0; i < READINGS; ++i) {
      if (absent(readings[i])) continue;
      double *row = raw + i * WIDTH;
      for (int j = 0; j < FITTED; ++j) row[j] = -by_fitted[i * FITTED + j];
      for (int s = 0; s < STATES; ++s)
        if (h[i * STATES + s] != 0) add(row, -h[i * STATES + s], slopes + s * FITTED, FITTED);
      row[FITTED] = readings[i] - expected[i];
    }
    memset(white, 0, sizeof white);
    add_product(white, whitening, raw, READINGS, READINGS, WIDTH);
    for (int i = 0; i < READINGS; ++i) {
      const double *row = white + i * WIDTH;
      for (int a = 0; a < WIDTH; ++a) add(normal + a * WIDTH, row[a], row, WIDTH);
      if (surprises) *surprises++ = absent(readings[i]) ? readings[i] : row[FITTED];
    }
    for (int s = 0; s < STATES; ++s)
      for (int i = 0; i < READINGS; ++i) {
        const double gain = gains[s * READINGS + i];
        if (gain == 0) continue;
        add(slopes + s * FITTED, gain, raw + i * WIDTH, FITTED);
        state[s] += gain * raw[i * WIDTH + FITTED];
      }
    advance(state, inputs, parameters, &derived, &moved);
    memcpy(state, moved.state, sizeof state);
    add_product(moved.by_fitted, moved.by_state, slopes, STATES, STATES, FITTED);
    memcpy(slopes, moved.by_fitted, STATES * FITTED * sizeof *slopes);
    *done = k + 1;
    if (!all_finite(state, STATES)) return DIVERGED;
    if (moved.margin < 0) return LEFT;
    inputs += INPUTS, readings += READINGS, gains += GAINS, whitening += WHITENING;
  }
  return COMPLETED;
}

/* What the last `watched` states were, by all readings: the modified Bryson–Frazier smoother (Bierman, Factorization
   Methods for Discrete Sequential Estimation, 1977), which goes backwards with the gains of `weigh`.
   states (samples × STATES) and covariances (samples × watched × STATES): as `weigh` gives them. smoothed
   (samples × watched) and spreads, their covariances (samples × watched²), are overwritten. Else as `weigh`. */
EXPORT int smooth(const double *parameters, const double *inputs, const double *readings, int64_t samples,
                  const double *states, const double *gains, const double *whitening, int64_t watched,
                  const double *covariances, double *smoothed, double *spreads) {
  Derived derived;
  Moved moved;
  double pull[STATES] = {0}, certainty[STATES * STATES] = {0}; /* slopes and curvature by what comes later */
  double turned[STATES], product[STATES * STATES], kept[STATES * STATES], expected[READINGS], h[READINGS * STATES];
  double by_fitted[READINGS * FITTED + 1], surprise[READINGS], white[READINGS], white_h[READINGS * STATES];
  derive(parameters, &derived);
  for (int64_t k = samples - 1; k >= 0; --k) {
    for (int64_t i = 0; i < watched; ++i) {
      const double *row = covariances + (k * watched + i) * STATES;
      double mean = states[k * STATES + STATES - watched + i];
      memset(turned, 0, sizeof turned);
      add_product(turned, row, certainty, 1, STATES, STATES);
      for (int j = 0; j < STATES; ++j) mean += row[j] * pull[j];
      smoothed[k * watched + i] = mean;
      for (int64_t other = 0; other < watched; ++other) {
        double spread = row[STATES - watched + other];
        for (int j = 0; j < STATES; ++j) spread -= turned[j] * covariances[(k * watched + other) * STATES + j];
        spreads[(k * watched + i) * watched + other] = spread;
      }
    }
    if (k == 0) break;
    advance(states + (k - 1) * STATES, inputs + (k - 1) * INPUTS, parameters, &derived, &moved);
    sense(moved.state, inputs + k * INPUTS, parameters, derived.for_sense, expected, h, by_fitted);
    const double *gain = gains + k * GAINS, *by = whitening + k * WHITENING;
    for (int i = 0; i < READINGS; ++i) {
      const double read = readings[k * READINGS + i];
      surprise[i] = absent(read) ? 0 : read - expected[i];
    }
    memset(white, 0, sizeof white);
    memset(white_h, 0, sizeof white_h);
    add_product(white, by, surprise, READINGS, READINGS, 1);
    add_product(white_h, by, h, READINGS, READINGS, STATES);
    memset(kept, 0, sizeof kept); /* share of a state that a correction leaves: 1 - gain h */
    for (int i = 0; i < STATES; ++i) {
      kept[i * STATES + i] = 1;
      for (int r = 0; r < READINGS; ++r) add(kept + i * STATES, -gain[i * READINGS + r], h + r * STATES, STATES);
    }
    /* before the correction, then before the move */
    memset(turned, 0, sizeof turned);
    add_product(turned, pull, kept, 1, STATES, STATES);
    add_product(turned, white, white_h, 1, READINGS, STATES);
    memset(pull, 0, sizeof pull);
    add_product(pull, turned, moved.by_state, 1, STATES, STATES);
    memset(product, 0, sizeof product);
    add_product(product, certainty, kept, STATES, STATES, STATES);
    memset(certainty, 0, sizeof certainty);
    for (int i = 0; i < STATES; ++i) /* kept' product + white_h' white_h */
      for (int j = 0; j < STATES; ++j) add(certainty + i * STATES, kept[j * STATES + i], product + j * STATES, STATES);
    for (int r = 0; r < READINGS; ++r)
      for (int i = 0; i < STATES; ++i) add(certainty + i * STATES, white_h[r * STATES + i], white_h + r * STATES, STATES);
    memset(product, 0, sizeof product);
    add_product(product, certainty, moved.by_state, STATES, STATES, STATES);
    memset(certainty, 0, sizeof certainty);
    for (int i = 0; i < STATES; ++i)
      for (int j = 0; j < STATES; ++j)
        add(certainty + i * STATES, moved.by_state[j * STATES + i], product + j * STATES, STATES);
    if (!all_finite(pull, STATES)) return DIVERGED;
  }
  return COMPLETED;
}
