/* Standard normals from words of 32 bits, by the inverse of their distribution function: one of each word, the larger the
   word (as a signed number) the larger the normal. As M. Giles approximates the inverse error function ("Approximating
   the erfinv function", GPU Computing Gems, 2011): where x in (-1, 1) is uniform and w = -log(1 - x^2), the normal is x
   times a polynomial in w, in the tails one in sqrt(w). Its relative error is below 1e-8, a fraction of the distance to
   the next word's. Additions, multiplications, divisions and square roots in a fixed order, none contracted: the same
   bits everywhere. Comes after philox.h, elementary.h and the polynomials of codegen/drivers/normal.py. */

#include <math.h>

static inline double uniform(uint32_t word) { return ((double)(int32_t)word + 0.5) * 0x1p-31; }

/* -log(1 - x^2) */
static inline double depth(double x) {
  double y = (1.0 - x) * (1.0 + x);
  uint64_t bits = to_bits(y), one = UINT64_C(0x3ff0000000000000);
  uint64_t biased = bits - UINT64_C(0x3fe6a09e667f3bcd) + one; /* less the bits of sqrt(1/2) */
  double n = from_bits(to_bits(ROUNDER) + (biased >> 52)) - (ROUNDER + 1023.0);
  double m = from_bits(bits - (biased & UINT64_C(0xfff0000000000000)) + one); /* sqrt(1/2) <= m < sqrt(2) */
  double s = (m - 1.0) / (m + 1.0);
  return -(n * LN_2 + s * log_polynomial(s * s));
}

/* Whether a word's normal lies in the tails: the smallest and the largest of signed words, next to each other here. */
static inline int in_tail(uint32_t word) { return word - TAIL < 2 * (UINT32_C(0x80000000) - TAIL); }

/* A normal in the tails. A call, as compilers would else work it out for every word. */
static __attribute__((noinline)) double normal_in_tail(double x) { return x * tail_polynomial(sqrt(depth(x))); }

/* The normals of a group of words. */
static void draw_normals(const uint32_t *restrict words, double *restrict normals) {
  uint32_t tails = 0;
  for (int i = 0; i < GROUP; ++i) {
    double x = uniform(words[i]);
    normals[i] = x * centre_polynomial(depth(x));
  }
  for (int i = 0; i < GROUP; ++i) tails |= in_tail(words[i]) ? 1 : 0;
  if (!tails) return;
  for (int i = 0; i < GROUP; ++i)
    if (in_tail(words[i])) normals[i] = normal_in_tail(uniform(words[i]));
}
