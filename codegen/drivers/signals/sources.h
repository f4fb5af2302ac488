/* What signals are, and what is given of them. Comes after philox.h. */

/* What a signal's random part is: none; a first-order Gauss-Markov signal within limits, stationary from sample 0 on, white
   noise where decay is 0; white noise uniform in [-1, 1]; 1 in outages, else 0. */
enum { NOTHING = 0, NORMAL = 1, UNIFORM = 2, OUTAGES = 3 };

typedef struct {
  const double *given; /* of the samples from given_from on; null: zero */
  int64_t given_from;
  int64_t kind; /* of the random part */
  uint64_t seed, stream;
  double sigma; /* standard deviation */
  double decay; /* from sample to sample */
  double limit; /* of the random part's magnitude */
  double state; /* standardised, of the last sample that was filled */
  int64_t period, length; /* samples of a window, which has one outage, and of an outage on average */
  int64_t from_zero;      /* whether it is zero before sample 0; else it is stationary */
} Signal;

/* White and Gauss-Markov signals side by side in WIDTH lanes, of some signals those of all sources; and the rows of a
   line that receive them: lane l of row r what element `from[r][l]` holds, the one beyond the last nothing. */
typedef struct {
  Keys keys;
  uint64_t stream[WIDTH];
  double decay[WIDTH], fresh[WIDTH], sigma[WIDTH], limit[WIDTH], start[WIDTH], state[WIDTH];
  Signal *signals[WIDTH];
  int count, uniform; /* how many; whether some are uniform */
  int rows, row[WIDTH], adds[WIDTH], from[WIDTH][WIDTH]; /* `adds`: to what is there */
  int whole; /* whether a row receives all, lane by lane */
} Bundle;

/* What runs in lanes receive, each from one of some sources. */
typedef struct {
  Signal *signals;       /* (sources, count) */
  const int64_t *source; /* (lanes,) which source a lane has; at most WIDTH lanes */
  int64_t sources, count, lanes;
  Bundle *bundles;   /* room for `count` of them */
  int64_t drawn; /* how many of them there are */
} Sources;

static inline const double *given_at(const Signal *signal, int64_t sample) {
  return signal->given ? signal->given + (sample - signal->given_from) : 0;
}

/* What is given of a signal; lanes whose sources have it from the same place all receive it at once. */
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
