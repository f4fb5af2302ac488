/* Elementary functions without branches, tables or calls, so that compilers inline them, overlap them and carry
   them out in vector lanes. Accurate to a few units in the last place over the ranges named; the same bits from
   every compiler that does not contract products (-ffp-contract=off). Not for non-finite arguments. Comes after driver.h. */

static inline double from_bits(uint64_t bits) {
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static inline double limited(double value, double lower, double upper) {
  value = value < lower ? lower : value;
  return value > upper ? upper : value;
}

/* Without a call where numbers need not be finite; y where one is NaN */
static inline double inline_fmin(double x, double y) { return x < y ? x : y; }
static inline double inline_fmax(double x, double y) { return x > y ? x : y; }

#define ROUNDER 6755399441055744.0 /* 1.5 * 2^52: adding it rounds to an integer, kept in the low bits */

/* 2^n for an integer n in [-1022, 1023], given as ROUNDER + n */
static inline double power_of_two(double shifted) { return from_bits((to_bits(shifted) + 1023) << 52); }

/* exp(r) - 1 for |r| <= ln(2)/2 */
static inline double expm1_near_zero(double r) {
  double p = 1.0 / 6227020800.0;
  p = p * r + 1.0 / 479001600.0;
  p = p * r + 1.0 / 39916800.0;
  p = p * r + 1.0 / 3628800.0;
  p = p * r + 1.0 / 362880.0;
  p = p * r + 1.0 / 40320.0;
  p = p * r + 1.0 / 5040.0;
  p = p * r + 1.0 / 720.0;
  p = p * r + 1.0 / 120.0;
  p = p * r + 1.0 / 24.0;
  p = p * r + 1.0 / 6.0;
  p = p * r + 0.5;
  return r + r * r * p;
}

#define LN2_HIGH 6.93147180369123816490e-01
#define LN2_LOW 1.90821492927058770002e-10

/* exp(x); below -708 it gives exp(-708), above 709 exp(709) */
static inline double inline_exp(double x) {
  x = limited(x, -708.0, 709.0);
  double shifted = x * 1.44269504088896340736 + ROUNDER;
  double n = shifted - ROUNDER;
  double r = (x - n * LN2_HIGH) - n * LN2_LOW;
  return power_of_two(shifted) * (1.0 + expm1_near_zero(r));
}

/* tanh(x) */
static inline double inline_tanh(double x) {
  double y = 2.0 * limited(x, -20.0, 20.0);
  double shifted = y * 1.44269504088896340736 + ROUNDER;
  double n = shifted - ROUNDER;
  double r = (y - n * LN2_HIGH) - n * LN2_LOW;
  double scale = power_of_two(shifted);
  double grown = scale * expm1_near_zero(r) + (scale - 1.0); /* exp(2 x) - 1 */
  return grown / (grown + 2.0);
}

/* sin(x) for |x| < 1e8; bounded beyond */
static inline double inline_sin(double x) {
  double shifted = x * 3.18309886183790671538e-01 + ROUNDER;
  double n = shifted - ROUNDER;
  double r = ((x - n * 3.14159265160560607910e+00) - n * 1.98418714791870343106e-09) - n * 1.14423774522196636802e-17;
  r = limited(r, -1.5707963267948968, 1.5707963267948968);
  double odd = from_bits(to_bits(shifted) << 63); /* the sign of (-1)^n */
  double q = r * r, p = -1.0 / 121645100408832000.0;
  p = p * q + 1.0 / 355687428096000.0;
  p = p * q - 1.0 / 1307674368000.0;
  p = p * q + 1.0 / 6227020800.0;
  p = p * q - 1.0 / 39916800.0;
  p = p * q + 1.0 / 362880.0;
  p = p * q - 1.0 / 5040.0;
  p = p * q + 1.0 / 120.0;
  p = p * q - 1.0 / 6.0;
  double sine = r + r * q * p;
  return from_bits(to_bits(sine) ^ to_bits(odd));
}

/* cos(x) for |x| < 1e8; its absolute error grows with x like the spacing of numbers there */
static inline double inline_cos(double x) { return inline_sin(x + 1.5707963267948966); }

/* log(x) for positive normal x */
static inline double inline_log(double x) {
  uint64_t bits = to_bits(x), one = UINT64_C(0x3ff0000000000000);
  uint64_t biased = bits - UINT64_C(0x3fe6a09e667f3bcd) + one; /* less the bits of sqrt(1/2) */
  double n = from_bits(to_bits(ROUNDER) + (biased >> 52)) - (ROUNDER + 1023.0);
  double m = from_bits(bits - (biased & UINT64_C(0xfff0000000000000)) + one); /* sqrt(1/2) <= m < sqrt(2) */
  double s = (m - 1.0) / (m + 1.0), q = s * s;
  double p = 1.0 / 21.0;
  p = p * q + 1.0 / 19.0;
  p = p * q + 1.0 / 17.0;
  p = p * q + 1.0 / 15.0;
  p = p * q + 1.0 / 13.0;
  p = p * q + 1.0 / 11.0;
  p = p * q + 1.0 / 9.0;
  p = p * q + 1.0 / 7.0;
  p = p * q + 1.0 / 5.0;
  p = p * q + 1.0 / 3.0;
  return n * LN2_HIGH + (2.0 * s + (2.0 * s * q * p + n * LN2_LOW));
}

/* x^y for positive normal x; relative error about |y log(x)| units in the last place */
static inline double inline_pow(double x, double y) { return inline_exp(y * inline_log(x)); }
