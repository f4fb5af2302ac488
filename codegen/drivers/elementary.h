/* Elementary functions without branches, tables or calls, which compilers can inline, overlap and vectorise. Their
   minimax polynomials have a relative error below 1e-9, far below the errors of models and integrators. Not for
   non-finite arguments. Comes after driver.h. */

static inline double from_bits(uint64_t bits) {
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static inline double limited(double value, double lower, double upper) {
  value = value < lower ? lower : value;
  return value > upper ? upper : value;
}

#define ROUNDER 6755399441055744.0 /* 1.5 * 2^52: adding it rounds to an integer, kept in the low bits */

/* 2^n for an integer n in [-1022, 1023], given as ROUNDER + n */
static inline double power_of_two(double shifted) { return from_bits((to_bits(shifted) + 1023) << 52); }

/* (2^r - 1)/r for |r| <= 1/2 */
static inline double growth(double r) {
  double p = 1.5252732376357989e-05;
  p = p * r + 0.00015461329790837012;
  p = p * r + 0.0013333669404763436;
  p = p * r + 0.009618057037574484;
  p = p * r + 0.05550410727637985;
  p = p * r + 0.24022650920045696;
  return p * r + 0.6931471805815643;
}

#define LOG2_E 1.44269504088896340736
#define LN_2 6.93147180559945309417e-01
#define SIGN UINT64_C(0x8000000000000000)

/* exp(x), between 2^-1022 and 2^1023 */
static inline double inline_exp(double x) {
  double y = limited(x * LOG2_E, -1022.0, 1023.0);
  double shifted = y + ROUNDER, r = y - (shifted - ROUNDER);
  return power_of_two(shifted) * (1.0 + r * growth(r));
}

/* tanh(x), from |x| */
static inline double inline_tanh(double x) {
  uint64_t sign = to_bits(x) & SIGN;
  double y = from_bits(to_bits(x) ^ sign) * (2.0 * LOG2_E);
  y = y < 60.0 ? y : 60.0;
  double shifted = y + ROUNDER, r = y - (shifted - ROUNDER);
  double scale = power_of_two(shifted);
  double grown = scale * (r * growth(r)) + (scale - 1.0); /* exp(2 |x|) - 1 */
  return from_bits(to_bits(grown / (grown + 2.0)) | sign);
}

/* sin(x) for |x| < 1e8, with an absolute error that grows like the spacing of numbers at x; bounded beyond */
static inline double inline_sin(double x) {
  double shifted = x * 3.18309886183790671538e-01 + ROUNDER;
  double r = limited(x - (shifted - ROUNDER) * 3.14159265358979323846, -1.5707963267948968, 1.5707963267948968);
  double odd = from_bits(to_bits(shifted) << 63); /* the sign of (-1)^n */
  double q = r * r, p = -2.3868351588279898e-08;
  p = p * q + 2.7523971377592263e-06;
  p = p * q - 1.9840832829534166e-04;
  p = p * q + 8.333330720610545e-03;
  p = p * q - 1.6666666608827654e-01;
  p = p * q + 9.999999999788497e-01;
  return from_bits(to_bits(r * p) ^ to_bits(odd));
}

/* cos(x), likewise */
static inline double inline_cos(double x) { return inline_sin(x + 1.5707963267948966); }

/* log(x) for positive normal x */
static inline double inline_log(double x) {
  uint64_t bits = to_bits(x), one = UINT64_C(0x3ff0000000000000);
  uint64_t biased = bits - UINT64_C(0x3fe6a09e667f3bcd) + one; /* less the bits of sqrt(1/2) */
  double n = from_bits(to_bits(ROUNDER) + (biased >> 52)) - (ROUNDER + 1023.0);
  double m = from_bits(bits - (biased & UINT64_C(0xfff0000000000000)) + one); /* sqrt(1/2) <= m < sqrt(2) */
  double s = (m - 1.0) / (m + 1.0), q = s * s, p = 2.9925649122495724e-01;
  p = p * q + 3.9974795006431870e-01;
  p = p * q + 6.6666815949821470e-01;
  p = p * q + 1.9999999986213474;
  return n * LN_2 + s * p;
}

/* x^y for positive normal x, with a relative error of about |y log(x)| times that of log */
static inline double inline_pow(double x, double y) { return inline_exp(y * inline_log(x)); }
