/* Standard normals from words of 32 bits, by the inverse of their distribution function: one from each word, increasing
   with the word (as a signed number). By the approximation of the inverse error function of M. Giles ("Approximating the
   erfinv function", GPU Computing Gems, 2011): for uniform x in (-1, 1) and w = -log(1 - x^2), the normal is x times a
   polynomial in w, in the tails one in sqrt(w). In single precision, with a relative error of 4e-7, for more lanes at a
   time. Additions, multiplications and square roots in a fixed order, without contraction, give the same bits everywhere.
   Comes after philox.h and the polynomials of codegen/drivers/signals/draws.py. */

#include <math.h>

static inline uint32_t float_bits(float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  return bits;
}

static inline float bits_float(uint32_t bits) {
  float value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

/* Number of words between zero and a word, taken as a signed number, and between the word and the last of its sign. */
static inline int32_t inner(uint32_t word) { return (int32_t)word ^ ((int32_t)word >> 31); }
static inline int32_t outer(uint32_t word) { return inner(word) ^ INT32_MAX; }

/* A number of words as a share of all words of one sign, plus half of the next. */
static inline float share(int32_t words) { return ((float)words + 0.5f) * 0x1p-31f; }

static inline float with_sign(float magnitude, uint32_t word) {
  return bits_float(float_bits(magnitude) | (word & UINT32_C(0x80000000)));
}

/* Uniform in [-1, 1]. */
static inline float uniform(uint32_t word) { return with_sign(share(inner(word)), word); }

/* -log(1 - x^2), from 1 - |x| */
static inline float depth(float t) {
  const float y = t * (2.0f - t);
  const int32_t n = (int32_t)(float_bits(y) - UINT32_C(0x3f3504f3)) >> 23; /* less the bits of sqrt(1/2) */
  const float f = bits_float(float_bits(y) - ((uint32_t)n << 23)) - 1.0f; /* sqrt(1/2) <= 1 + f < sqrt(2) */
  return -((float)n * LN_2F + f * log_polynomial(f));
}

static inline int in_tail(uint32_t word) { return outer(word) < IN_TAIL; }

/* A normal's magnitude in the tails. Not inlined, as compilers would compute it for every word. */
static __attribute__((noinline)) float magnitude_in_tail(float x, float w) {
  return x * tail_polynomial(sqrtf(w) - TAIL_MIDDLE);
}

/* The normals of BLOCK * WIDTH words, in two loops to hide the latency of instructions. */
static __attribute__((noinline)) void draw_normals(const uint32_t *restrict words, float *restrict normals) {
  float x[BLOCK * WIDTH], w[BLOCK * WIDTH];
  int32_t outermost = INT32_MAX;
  for (int i = 0; i < BLOCK * WIDTH; ++i) {
    x[i] = share(inner(words[i]));
    w[i] = depth(share(outer(words[i])));
    outermost = outer(words[i]) < outermost ? outer(words[i]) : outermost;
  }
  for (int i = 0; i < BLOCK * WIDTH; ++i)
    normals[i] = with_sign(x[i] * centre_polynomial(w[i] - CENTRE_MIDDLE), words[i]);
  if (outermost >= IN_TAIL) return;
  for (int i = 0; i < BLOCK * WIDTH; ++i)
    if (in_tail(words[i])) normals[i] = with_sign(magnitude_in_tail(x[i], w[i]), words[i]);
}
