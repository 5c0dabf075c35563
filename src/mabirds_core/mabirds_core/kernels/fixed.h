/* exp and log of fixed arithmetic: additions, multiplications and divisions in a stated order, so that every processor
   gives the same bits. Within 1.5 units in the last place of the exact value. Written without branches, so that
   compilers turn loops over them into vectors; polynomials go by pairs (Estrin), so that few operations wait for others.
   Compile with -ffp-contract=off. */
#ifndef MABIRDS_FIXED_H
#define MABIRDS_FIXED_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#define FIXED_LN2_HIGH 6.93147180369123816490e-01 /* its last 32 bits are 0: small multiples are exact */
#define FIXED_LN2_LOW 1.90821492927058770002e-10
#define FIXED_LOG2_E 1.44269504088896338700e+00
#define FIXED_ROUND 6755399441055744.0 /* 1.5 * 2^52: adding it leaves a rounded integer in the last bits */
#define FIXED_EXP_LEAST -708.0         /* what lies below becomes 0 */
#define FIXED_EXP_MOST 709.0           /* what lies above becomes infinite */

static inline uint64_t fixed_bits(double x) {
  uint64_t bits;
  memcpy(&bits, &x, sizeof bits);
  return bits;
}

static inline double fixed_double(uint64_t bits) {
  double x;
  memcpy(&x, &bits, sizeof x);
  return x;
}

/* exp(x) = 2^n exp(r), |r| <= ln(2) / 2, by the Taylor polynomial of degree 13. */
static inline double fixed_exp(double x) {
  double inside = x < FIXED_EXP_LEAST ? FIXED_EXP_LEAST : x;
  inside = inside > FIXED_EXP_MOST ? FIXED_EXP_MOST : inside;
  double shifted = inside * FIXED_LOG2_E + FIXED_ROUND;
  double n = shifted - FIXED_ROUND;
  double r = (inside - n * FIXED_LN2_HIGH) - n * FIXED_LN2_LOW;
  double r2 = r * r, r4 = r2 * r2;
  double p2 = 0.5 + r * (1.0 / 6.0), p4 = 1.0 / 24.0 + r * (1.0 / 120.0), p6 = 1.0 / 720.0 + r * (1.0 / 5040.0);
  double p8 = 1.0 / 40320.0 + r * (1.0 / 362880.0), p10 = 1.0 / 3628800.0 + r * (1.0 / 39916800.0);
  double p12 = 1.0 / 479001600.0 + r * (1.0 / 6227020800.0);
  double p = (p2 + p4 * r2) + r4 * ((p6 + p8 * r2) + r4 * (p10 + p12 * r2));
  p = 1.0 + (r + r2 * p);
  double y = p * fixed_double((fixed_bits(shifted) + 1023) << 52);
  y = x < FIXED_EXP_LEAST ? 0.0 : y;
  y = x > FIXED_EXP_MOST ? INFINITY : y;
  return x != x ? x : y;
}

/* log(x) = e ln 2 + 2 artanh(s), s = (m - 1) / (m + 1), with x = 2^e m and m in [sqrt(1/2), sqrt(2)]. Numbers below the
   smallest normal one count as 0, whose logarithm is -infinity; negative numbers have none. */
static inline double fixed_log(double x) {
  uint64_t bits = fixed_bits(x) + (0x3ff0000000000000u - 0x3fe6a09e667f3bcdu);
  double e = fixed_double((bits >> 52) | 0x4330000000000000u) - 4503599627370496.0 - 1023.0;
  double m = fixed_double((bits & 0x000fffffffffffffu) + 0x3fe6a09e667f3bcdu);
  double f = m - 1.0;
  double s = f / (2.0 + f);
  double z = s * s;
  double z2 = z * z, z4 = z2 * z2;
  double p0 = 2.0 / 3.0 + z * (2.0 / 5.0), p2 = 2.0 / 7.0 + z * (2.0 / 9.0), p4 = 2.0 / 11.0 + z * (2.0 / 13.0);
  double p6 = 2.0 / 15.0 + z * (2.0 / 17.0), p8 = 2.0 / 19.0 + z * (2.0 / 21.0), p10 = 2.0 / 23.0;
  double p = (p0 + p2 * z2) + z4 * ((p4 + p6 * z2) + z4 * (p8 + p10 * z2));
  double half = 0.5 * f * f; /* log(1 + f) = f - (f^2/2 - s (f^2/2 + z p)) */
  double y = e * FIXED_LN2_HIGH - ((half - (s * (half + z * p) + e * FIXED_LN2_LOW)) - f);
  y = x < 2.2250738585072014e-308 ? -INFINITY : y;
  y = x == INFINITY ? x : y;
  return x < 0.0 || x != x ? NAN : y;
}

#endif
