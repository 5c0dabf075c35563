/* exp and log of arrays. */
#include "kernels.h"

#include "fixed.h"

KERNEL void mabirds_exp(const double *restrict x, double *restrict y, int64_t n) {
  for (int64_t i = 0; i < n; i++) y[i] = fixed_exp(x[i]);
}

KERNEL void mabirds_log(const double *restrict x, double *restrict y, int64_t n) {
  for (int64_t i = 0; i < n; i++) y[i] = fixed_log(x[i]);
}
