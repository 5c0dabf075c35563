/* One step of C_t = r_12 + log( P_1 exp(gamma C_{t+1}) P_2^T ), what two drones cost each other
   (games/drones/coupling.py). Rows and columns change places from step to step, so that both products run along
   neighbouring numbers: 32 rows at a time, all columns are gathered by P of the drone that has the rows, turned round, and
   gathered by P of the other one. Sums are taken move by move, in the order of the moves.

   Tables of R rows are kept in strips of LANES columns, (strips, R, LANES): what is gathered together lies together. */
#include <stdlib.h>

#include "fixed32.h"
#include "kernels.h"

#define LANES 32
#define INLINE __attribute__((always_inline)) /* into every clone of the kernel */

typedef float part __attribute__((vector_size(LANES), aligned(4))); /* of LANES / 4: a register of AVX */
#define PART (LANES / 4)

typedef struct {
  int64_t count;        /* n_t: nodes that the drone can have reached */
  int64_t moves;        /* A */
  const int32_t *nodes; /* where the moves lead, (n_t, A) */
  const float *chances; /* P_t, (n_t, A) */
} mover;

/* sum_a chances[a] strip[nodes[a]][..], for its LANES columns. */
static inline INLINE void gather(const mover *by, int64_t row, const float *strip, float *out) {
  const int32_t *nodes = by->nodes + row * by->moves;
  const float *chances = by->chances + row * by->moves;
  part sums[4] = {{0}};
  for (int64_t a = 0; a < by->moves; a++) {
    const float *from = strip + (int64_t)nodes[a] * LANES;
    for (int k = 0; k < 4; k++)
      sums[k] += chances[a] * *(const part *)(from + k * PART);
  }
  for (int k = 0; k < 4; k++)
    *(part *)(out + k * PART) = sums[k];
}

/* PART rows of as many columns, turned round: three shuffles of cards bring row i, column k to row k, column i. */
static inline INLINE void turn(const float *from, int64_t from_stride, float *to, int64_t to_stride) {
  part cards[PART], shuffled[PART];
  for (int k = 0; k < PART; k++)
    cards[k] = *(const part *)(from + k * from_stride);
  for (int shuffle = 0; shuffle < 3; shuffle++) {
    for (int k = 0; k < PART / 2; k++) {
      part one = cards[k], other = cards[k + PART / 2];
      shuffled[2 * k] = __builtin_shufflevector(one, other, 0, 8, 1, 9, 2, 10, 3, 11);
      shuffled[2 * k + 1] = __builtin_shufflevector(one, other, 4, 12, 5, 13, 6, 14, 7, 15);
    }
    memcpy(cards, shuffled, sizeof cards);
  }
  for (int k = 0; k < PART; k++)
    *(part *)(to + k * to_stride) = cards[k];
}

/* P_rows ahead for LANES rows from ``first`` on, turned round: (columns of ahead, LANES). Beyond the last row: the last
   row again. */
static inline INLINE void turned_rows(const mover *rows, int64_t first, const float *ahead, int64_t ahead_rows,
                                      int64_t ahead_strips, float *to) {
  float block[LANES * LANES];
  for (int64_t s = 0; s < ahead_strips; s++, ahead += ahead_rows * LANES, to += LANES * LANES) {
    for (int64_t lane = 0; lane < LANES; lane++) {
      int64_t row = first + lane < rows->count ? first + lane : rows->count - 1;
      gather(rows, row, ahead, block + lane * LANES);
    }
    for (int64_t k = 0; k < LANES; k += PART)
      for (int64_t lane = 0; lane < LANES; lane += PART)
        turn(block + lane * LANES + k, LANES, to + k * LANES + lane, LANES);
  }
}

/* values = log(sums) + pair + constant, and the largest by lane; sums below the smallest normal number count as that. */
static inline INLINE void backed_up(const float *sums, const float *pair, float constant, float *values, float *most) {
  for (int64_t k = 0; k < LANES; k++) {
    float sum = sums[k] < 1.17549435e-38f ? 1.17549435e-38f : sums[k];
    values[k] = fixed32_log(sum) + pair[k] + constant;
    most[k] = values[k] > most[k] ? values[k] : most[k];
  }
}

/* C_t with a row for each node of ``columns`` and a column for each of ``rows``, from ahead = exp(gamma C_{t+1}) with
   rows and columns the other way round. ``pairs`` has ``pairs_rows`` rows, at least as many as C_t. Columns that fill the
   last strip repeat the last node, but for what pairs earn. Returns the largest value of all others, or NaN where there
   is no memory for 32 rows. */
KERNEL float mabirds_couple(const mover *rows, const mover *columns, const float *ahead, int64_t ahead_rows,
                            int64_t ahead_strips, const float *pairs, int64_t pairs_rows, float constant,
                            float *values) {
  float sums[LANES], most[LANES], largest = -__builtin_inff();
  float *turned = malloc((size_t)ahead_strips * LANES * LANES * sizeof *turned);
  if (turned == NULL)
    return __builtin_nanf("");
  for (int64_t first = 0; first < rows->count; first += LANES) {
    turned_rows(rows, first, ahead, ahead_rows, ahead_strips, turned);
    for (int64_t k = 0; k < LANES; k++)
      most[k] = -__builtin_inff();
    for (int64_t row = 0; row < columns->count; row++) {
      gather(columns, row, turned, sums);
      backed_up(sums, pairs + row * LANES, constant, values + row * LANES, most);
    }
    for (int64_t k = 0; k < LANES && first + k < rows->count; k++)
      largest = most[k] > largest ? most[k] : largest;
    pairs += pairs_rows * LANES;
    values += columns->count * LANES;
  }
  free(turned);
  return largest;
}

/* Codes of C_t, in steps of 1 / per_nat below ``top``, and in its place exp(gamma (C_t - top) + lift). */
KERNEL void mabirds_encode(float *values, int64_t count, float top, float per_nat, float discount, float lift,
                           uint16_t *codes) {
  for (int64_t i = 0; i < count; i++) {
    float below = top > values[i] ? top - values[i] : 0.0f; /* what fills the last strip may be larger */
    float steps = below * per_nat + 0.5f;
    codes[i] = (uint16_t)(int32_t)(steps < 65535.0f ? steps : 65535.0f);
    values[i] = fixed32_exp(lift - discount * below);
  }
}
