/* Common definitions of the drivers. */

#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Outcome of a run: `Outcome` of codegen/drivers/outcome.py. */
enum { COMPLETED = 0, DIVERGED = 1, LEFT = 2, GIVEN_UP = 3, RUNNING = 4 };

static inline uint64_t to_bits(double value) {
  uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  return bits;
}

/* Overflows into the highest bit for infinities and NaN, whose exponent is all ones. It uses bits, as the optimiser may
   remove floating-point comparisons. */
static inline uint64_t overflow(double value) {
  return (to_bits(value) & UINT64_C(0x7ff0000000000000)) + UINT64_C(0x0010000000000000);
}

static inline int all_finite(const double *values, int count) {
  uint64_t overflows = 0;
  for (int i = 0; i < count; ++i) overflows |= overflow(values[i]);
  return !(overflows >> 63);
}
