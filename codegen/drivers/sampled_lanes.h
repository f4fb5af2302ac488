/* The functions of codegen/sampled.py but `observe` over LANES lanes, with arrays of stride LANES, and
   derive(parameters, derived) for expressions of the parameters alone. Comes after lanes.h, the sizes and the
   functions. Each loop over the lanes needs a function of its own with restrict pointers, or compilers do not see that
   lanes do not mix. */

/* Few runs at a time need all parts of the interval, as few have a slack rope: lanes move in portions of one vector (two
   for clang, which interleaves them), or all together where they are paired. */
#if LANES == 1 || PAIRED
#define PORTION LANES
#elif defined(__clang__) || defined(__AVX512F__)
#define PORTION 8
#else
#define PORTION 4
#endif

IN_LANES move_lanes(const double *restrict motion, const double *restrict hold, const double *restrict part,
                    const double *restrict p, const double *restrict derived, double *restrict next,
                    double *restrict margin) {
  EACH_CALL_OF(PORTION) move(motion + l, hold + l, part, p + l, derived + l, next + l, margin + l);
}

/* All parts of the sample interval, in the portions of the lanes in which a lane is `wanted` (positive). */
static void move_on(const double *wanted, const double *now, const double *hold, const double *p, const double *derived,
                    double *next, double *margin) {
  LANE_ARRAY between[MOTION * LANES];
  for (int at = 0; at < LANES; at += PORTION) {
    int any = 0;
    EACH_OF(PORTION) any |= wanted[at + l] > 0;
    const double *from = now + at;
    for (int part = 0; any && part < PARTS; ++part) {
      const double number = part;
      double *to = ((PARTS - part) % 2 ? next : between) + at;
      move_lanes(from, hold + at, &number, p + at, derived + at, to, margin + at);
      from = to;
    }
  }
}

/* NAME_lanes: the sample `NAME`, and the one-step update if there is one, in the same loop, as it need not wait for
   values that only the next sample reads. */
#if HAS_ONE_STEP
#define SAMPLE_LANES(NAME)                                                                                           \
  IN_LANES NAME##_lanes(const double *restrict state, const double *restrict exogenous, const double *restrict p,    \
                        const double *restrict derived, double *restrict discrete, double *restrict hold,            \
                        double *restrict next, double *restrict margin, double *restrict valid) {                    \
    EACH_CALL {                                                                                                      \
      NAME(state + l, exogenous + l, p + l, derived + l, discrete + l, hold + l);                                    \
      one_step(state + l, hold + l, p + l, derived + l, next + l, margin + l, valid + l);                            \
    }                                                                                                                \
  }
#else
#define SAMPLE_LANES(NAME)                                                                                           \
  IN_LANES NAME##_lanes(const double *restrict state, const double *restrict exogenous, const double *restrict p,    \
                        const double *restrict derived, double *restrict discrete, double *restrict hold) {          \
    EACH_CALL NAME(state + l, exogenous + l, p + l, derived + l, discrete + l, hold + l);                            \
  }
#endif

SAMPLE_LANES(sample)

#if HAS_FAST_SAMPLE
SAMPLE_LANES(fast_sample)

/* Whether no lane's phase is 0. */
static __attribute__((noinline)) int all_fast(const double *restrict phase) {
  int64_t due = 0;
  EACH_LANE due |= phase[l] != 0 ? 0 : -1;
  return due == 0;
}

#define SAMPLE_BY_PHASE(now, ...) \
  (all_fast((now) + PHASE * LANES) ? fast_sample_lanes(now, __VA_ARGS__) : sample_lanes(now, __VA_ARGS__))
#else
#define SAMPLE_BY_PHASE(...) sample_lanes(__VA_ARGS__)
#endif

IN_LANES derive_lanes(const double *restrict p, double *restrict derived) {
  EACH_LANE derive(p + l, derived + l);
}

/* Copies `from` to `into` in lanes with a positive choice. */
IN_LANES take_over(const double *restrict choice, double *restrict into, const double *restrict from, int count) {
  for (int i = 0; i < count; ++i)
    EACH_LANE into[i * LANES + l] = choice[l] > 0 ? from[i * LANES + l] : into[i * LANES + l];
}

IN_LANES find_finite(const double *restrict state, uint64_t *restrict finite) {
  uint64_t overflows[LANES] = {0};
  for (int i = 0; i < STATES; ++i)
    EACH_LANE overflows[l] |= overflow(state[i * LANES + l]);
  EACH_LANE finite[l] = !(overflows[l] >> 63);
}
