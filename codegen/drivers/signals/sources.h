/* Definition of signals, and their given parts. Comes after philox.h. */

/* Kind of a signal's random part: none; a limited first-order Gauss-Markov signal, stationary from sample 0 on, white
   noise for a decay of 0; white noise uniform in [-1, 1]; 1 in outages, else 0. */
enum { NOTHING = 0, NORMAL = 1, UNIFORM = 2, OUTAGES = 3 };

typedef struct {
  const double *given; /* values from sample given_from on; null: zero */
  int64_t given_from;
  int64_t kind; /* kind of the random part */
  uint64_t seed, stream;
  double sigma; /* standard deviation */
  double decay; /* autocorrelation from sample to sample */
  double limit; /* limit of the random part's magnitude */
  double state; /* standardised state of the last filled sample */
  int64_t period, length; /* samples of a window with one outage, and mean samples of an outage */
  int64_t from_zero;      /* whether it is zero before sample 0; else it is stationary */
} Signal;

/* White and Gauss-Markov signals in WIDTH lanes, for some signals those of all sources; and the rows of a line that
   receive them: lane l of row r receives element `from[r][l]`, zero for the one beyond the last. */
typedef struct {
  Keys keys;
  uint64_t stream[WIDTH];
  double decay[WIDTH], fresh[WIDTH], sigma[WIDTH], limit[WIDTH], start[WIDTH], state[WIDTH];
  Signal *signals[WIDTH];
  int count, uniform; /* number of signals; whether some are uniform */
  int rows, row[WIDTH], adds[WIDTH], from[WIDTH][WIDTH]; /* `adds`: whether added to the present value */
  int whole; /* whether a row receives all lanes in order */
} Bundle;

/* The signals of runs in lanes, each from one of the sources. */
typedef struct {
  Signal *signals;       /* (sources, count) */
  const int64_t *source; /* (lanes,) source of each lane; at most WIDTH lanes */
  int64_t sources, count, lanes;
  Bundle *bundles;   /* memory for `count` bundles */
  int64_t drawn; /* number of bundles */
} Sources;

static inline const double *given_at(const Signal *signal, int64_t sample) {
  return signal->given ? signal->given + (sample - signal->given_from) : 0;
}

/* Copies the given part of a signal; lanes with the same data are filled together. */
static inline void give(const Sources *sources, int64_t i, int64_t first, int64_t samples, double *restrict out,
                        const int64_t lanes) {
  const int64_t line = sources->count * lanes;
  const Signal *signals = sources->signals + i;
  const double *given = given_at(signals, first);
  int shared = 1;
  for (int64_t s = 1; s < sources->sources; ++s) shared &= given_at(signals + s * sources->count, first) == given;
  if (shared) {
    for (int64_t k = 0; k < samples; ++k) {
      const double value = given ? given[k] : 0.0;
      for (int64_t l = 0; l < lanes; ++l) out[k * line + l] = value;
    }
    return;
  }
  for (int64_t l = 0; l < lanes; ++l) {
    given = given_at(signals + sources->source[l] * sources->count, first);
    for (int64_t k = 0; k < samples; ++k) out[k * line + l] = given ? given[k] : 0.0;
  }
}
