/* exp and log of fixed arithmetic in single precision, as fixed.h has them in double precision: within two units in the
   last place, the same bits on every processor, and no branches. */
#ifndef MABIRDS_FIXED32_H
#define MABIRDS_FIXED32_H

#include <stdint.h>
#include <string.h>

#define FIXED32_LN2_HIGH 0.693359375f /* its last 15 bits are 0: small multiples are exact */
#define FIXED32_LN2_LOW -2.12194440e-4f
#define FIXED32_LOG2_E 1.44269504f
#define FIXED32_ROUND 12582912.0f /* 1.5 * 2^23: adding it leaves a rounded integer in the last bits */
#define FIXED32_EXP_LEAST -87.0f  /* what lies below becomes 0 */

static inline uint32_t fixed32_bits(float x) {
  uint32_t bits;
  memcpy(&bits, &x, sizeof bits);
  return bits;
}

static inline float fixed32_float(uint32_t bits) {
  float x;
  memcpy(&x, &bits, sizeof x);
  return x;
}

/* exp(x) = 2^n exp(r), |r| <= ln(2) / 2, by the Taylor polynomial of degree 7; for x up to 88. */
static inline float fixed32_exp(float x) {
  float inside = x < FIXED32_EXP_LEAST ? FIXED32_EXP_LEAST : x;
  float shifted = inside * FIXED32_LOG2_E + FIXED32_ROUND;
  float n = shifted - FIXED32_ROUND;
  float r = (inside - n * FIXED32_LN2_HIGH) - n * FIXED32_LN2_LOW;
  float p = 1.0f / 5040.0f;
  p = p * r + 1.0f / 720.0f;
  p = p * r + 1.0f / 120.0f;
  p = p * r + 1.0f / 24.0f;
  p = p * r + 1.0f / 6.0f;
  p = p * r + 0.5f;
  p = 1.0f + (r + r * r * p);
  float y = p * fixed32_float((fixed32_bits(shifted) + 127u) << 23);
  return x < FIXED32_EXP_LEAST ? 0.0f : y;
}

/* log(x) = e ln 2 + 2 artanh(s), s = (m - 1) / (m + 1), with x = 2^e m and m in [sqrt(1/2), sqrt(2)]; for normal,
   positive, finite x. */
static inline float fixed32_log(float x) {
  uint32_t bits = fixed32_bits(x) + (0x3f800000u - 0x3f3504f3u);
  float e = (float)(int32_t)(bits >> 23) - 127.0f;
  float m = fixed32_float((bits & 0x007fffffu) + 0x3f3504f3u);
  float f = m - 1.0f;
  float s = f / (2.0f + f);
  float z = s * s;
  float p = 2.0f / 9.0f;
  p = p * z + 2.0f / 7.0f;
  p = p * z + 2.0f / 5.0f;
  p = p * z + 2.0f / 3.0f;
  float half = 0.5f * f * f; /* log(1 + f) = f - (f^2/2 - s (f^2/2 + z p)) */
  return e * FIXED32_LN2_HIGH - ((half - (s * (half + z * p) + e * FIXED32_LN2_LOW)) - f);
}

#endif
