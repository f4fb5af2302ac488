/* Rows of rollouts in lanes (batch.c), in a library of their own. Comes after driver.h, elementary.h, lanes.h, the sizes
   and the function `observe` of codegen/sampled.py with derive(parameters, derived), over arrays of stride LANES. */

EXPORT const int64_t derived_size = (DERIVED + 1) * LANES;

EXPORT void begin_rows(const double *restrict p, double *restrict derived) {
  EACH_LANE derive(p + l, derived + l);
}

EXPORT void row_at(const double *restrict state, const double *restrict exogenous, const double *restrict p,
                   const double *restrict derived, double *restrict row) {
  EACH_CALL observe(state + l, exogenous + l, p + l, derived + l, row + l);
}
