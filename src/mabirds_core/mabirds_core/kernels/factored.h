/* A game of experts who move independently of each other, and what its two passes have in common.

   Expert i stands in one of n cells c_i and makes one of M moves; a joint state is the mixed-radix number of the cells
   (expert 1 most significant), joint actions likewise. Rewards are

       R(s, a) = sum_i w_i(c_i, m_i) + D(s) + W[level(s, a)],     level = 0, W[0] = 0 but in the few coupled states.

   phi_i is the soft value of expert i alone, p_i(m | c) its policy. What remains of the joint value is the gain

       G_t(s) = V_t(s) - sum_i phi_i,t(c_i) = D(s) + log sum_a prod_i p_i(m_i | c_i) exp(W[level] + gamma G_t+1(s')),

   which is 0 where nothing couples the experts, however large the rewards are. With X = exp(gamma (G - shift)) the sum
   is a product of N sparse matrices, one expert after the other. Factors below exp(-cut) count as 0, so that no product
   of them leaves the range of normal numbers. In a coupled state the few actions of a level above 0 are corrected by
   exp(W) - 1 times their part of the sum. Where a sum is so small that the cut could matter, or the correction would take
   most of it, the state is summed in logs, action by action. All sums have one order. */
#ifndef MABIRDS_FACTORED_H
#define MABIRDS_FACTORED_H

#include <stdlib.h>

#include "fixed.h"
#include "kernels.h"

#define INLINE static inline __attribute__((always_inline))
#define MOST_EXPERTS 16
#define MOST_MOVES 256
#define RANGE 690.0 /* nats: exp(-RANGE) is a normal number */
#define MARGIN 50.0 /* nats: what lies this far below a sum is nothing to it */
#define MOST_GAINED 30.0 /* W above it is summed in logs */
#define MOST_TAKEN 0.5   /* share of a sum that a correction may take */

typedef double lanes __attribute__((vector_size(32), aligned(8), may_alias));
typedef int64_t lane_bits __attribute__((vector_size(32), aligned(8), may_alias));
#define LANES(p) (*(const lanes *)(p))
#define LANES_OF(p) (*(lanes *)(p))

/* As ``kernels/factored.py`` fills it. */
typedef struct {
  int64_t experts, cells, moves, states, horizon, offsets, coupled, ways, levels;
  double discount;
  const int32_t *successor;      /* [expert][cell][move] */
  const int32_t *offset;         /* [offsets]: all different successor - cell of the last expert */
  const int32_t *offset_of;      /* [cell][move]: which of them */
  const int32_t *coupled_states; /* [coupled], rising */
  const uint8_t *coupled_levels; /* [coupled][joint action] */
  const uint8_t *way_levels;     /* [ways] */
  const int32_t *way_of;         /* [ways]: number of the coupled state, rising; all actions of a level above 0 */
  const int32_t *way_after;      /* [ways]: the state after */
  const int32_t *way_entries;    /* [ways][expert]: place in [expert][cell][move] */
  const double *move_weights;    /* w: [expert][cell][move] */
  const double *state_weights;   /* D: [state] */
  const double *level_weights;   /* W: [level] */
} Game;

/* What both passes work with; one block of memory. Arrays of states have n cells of padding at both ends, which are
   read with weight 0. */
typedef struct {
  void *block;
  int64_t slab, actions;
  double cut, least;
  const double *chances;            /* p of this step: [expert][cell][move] */
  const double *phi, *next_phi;     /* of this step and the next: [expert][cell] */
  double *taps;                     /* [offsets][cell]: of the last expert, by where the moves lead */
  double *levels;                   /* exp(W), where that is used: [level] */
  double *partial[MOST_EXPERTS + 1]; /* [k]: experts after k have moved; [experts] is X itself */
  double *mass;                     /* [slab] */
  double *value;                    /* [joint action] */
  int32_t *after;                   /* [joint action] */
  int32_t *digits;                  /* [joint action][expert]: its moves */
  int64_t next_coupled, next_way;   /* the first that lie beyond the slabs seen in this step */
} Work;

INLINE double *take(double **free_space, int64_t size) {
  double *start = *free_space;
  *free_space += size;
  return start;
}

INLINE int64_t power(int64_t base, int64_t exponent) {
  int64_t product = 1;
  while (exponent-- > 0) product *= base;
  return product;
}

INLINE void prepare_tables(const Game *g, Work *w) {
  for (int64_t l = 0; l < g->levels; l++)
    w->levels[l] = fixed_exp(g->level_weights[l] < MOST_GAINED ? g->level_weights[l] : MOST_GAINED);
  for (int64_t a = 0; a < w->actions; a++) {
    int64_t rest = a;
    for (int64_t i = g->experts - 1; i >= 0; i--) {
      w->digits[a * g->experts + i] = (int32_t)(rest % g->moves);
      rest /= g->moves;
    }
  }
}

/* ``more`` doubles beside what both passes need start at ``*rest``; 0 where there is no memory. */
INLINE int prepare(const Game *g, Work *w, int64_t more, double **rest) {
  int64_t padded = g->states + 2 * g->cells;
  w->slab = g->states / g->cells;
  w->actions = power(g->moves, g->experts);
  int64_t size = g->offsets * g->cells + g->levels + (g->experts - 1) * padded + w->slab +
                 (2 + g->experts) * w->actions;
  w->block = calloc((size_t)(size + more), sizeof(double));
  if (!w->block) return 0;
  double *space = w->block;
  w->cut = RANGE / (double)(g->experts + 1);
  w->least = fixed_exp(MARGIN - w->cut);
  w->taps = take(&space, g->offsets * g->cells);
  w->levels = take(&space, g->levels);
  for (int64_t k = 1; k < g->experts; k++) w->partial[k] = take(&space, padded) + g->cells;
  w->mass = take(&space, w->slab);
  w->value = take(&space, w->actions);
  w->after = (int32_t *)take(&space, w->actions);
  w->digits = (int32_t *)take(&space, g->experts * w->actions);
  prepare_tables(g, w);
  *rest = space;
  return 1;
}

/* The last expert's p by where its moves lead, so that a row of its cells is a sum of shifted rows. */
INLINE void step_taps(const Game *g, const double *chances, double *taps) {
  const double *own = chances + (g->experts - 1) * g->cells * g->moves;
  for (int64_t k = 0; k < g->offsets * g->cells; k++) taps[k] = 0.0;
  for (int64_t c = 0; c < g->cells; c++)
    for (int64_t m = 0; m < g->moves; m++)
      taps[g->offset_of[c * g->moves + m] * g->cells + c] += own[c * g->moves + m];
}

/* phi: [T + 2][expert][cell]; chances: [T + 1][expert][cell][move]; X of the next step. */
INLINE void begin(const Game *g, Work *w, int64_t t, const double *phi, const double *chances, double *onward) {
  int64_t rows = g->experts * g->cells;
  w->chances = chances + t * rows * g->moves;
  w->phi = phi + t * rows;
  w->next_phi = phi + (t + 1) * rows;
  w->partial[g->experts] = onward + (t + 1) * g->states;
  w->next_coupled = w->next_way = 0;
  step_taps(g, w->chances, w->taps);
}

/* to = sum_m p[m] from[m], rows of ``size``. */
INLINE void combine_some(double *to, const double *const *from, const double *p, int64_t moves, int64_t size) {
  int64_t j = 0;
  for (; j + 8 <= size; j += 8) {
    lanes a = {0.0}, b = {0.0};
    for (int64_t m = 0; m < moves; m++) {
      a += p[m] * LANES(from[m] + j);
      b += p[m] * LANES(from[m] + j + 4);
    }
    LANES_OF(to + j) = a;
    LANES_OF(to + j + 4) = b;
  }
  for (; j + 4 <= size; j += 4) {
    lanes a = {0.0};
    for (int64_t m = 0; m < moves; m++) a += p[m] * LANES(from[m] + j);
    LANES_OF(to + j) = a;
  }
  for (; j < size; j++) {
    double a = 0.0;
    for (int64_t m = 0; m < moves; m++) a += p[m] * from[m][j];
    to[j] = a;
  }
}

INLINE void combine(double *to, const double *const *from, const double *p, int64_t moves, int64_t size) {
  if (moves == 4) combine_some(to, from, p, 4, size); /* lets the compiler unroll */
  else combine_some(to, from, p, moves, size);
}

/* to = sum over offsets of weights[o] * from shifted by sign * offset, one row of cells. */
INLINE void shift_some(double *to, const double *from, const double *weights, const int32_t *offset, int64_t sign,
                       int64_t offsets, int64_t cells) {
  int64_t j = 0;
  for (; j + 8 <= cells; j += 8) {
    lanes a = {0.0}, b = {0.0};
    for (int64_t o = 0; o < offsets; o++) {
      const double *moved = from + sign * offset[o] + j, *weight = weights + o * cells + j;
      a += LANES(weight) * LANES(moved);
      b += LANES(weight + 4) * LANES(moved + 4);
    }
    LANES_OF(to + j) = a;
    LANES_OF(to + j + 4) = b;
  }
  for (; j + 4 <= cells; j += 4) {
    lanes a = {0.0};
    for (int64_t o = 0; o < offsets; o++)
      a += LANES(weights + o * cells + j) * LANES(from + sign * offset[o] + j);
    LANES_OF(to + j) = a;
  }
  for (; j < cells; j++) {
    double a = 0.0;
    for (int64_t o = 0; o < offsets; o++) a += weights[o * cells + j] * from[sign * offset[o] + j];
    to[j] = a;
  }
}

INLINE void shift_row(double *to, const double *from, const double *weights, const Game *g, int64_t sign) {
  if (g->offsets == 5) shift_some(to, from, weights, g->offset, sign, 5, g->cells);
  else shift_some(to, from, weights, g->offset, sign, g->offsets, g->cells);
}

/* Rows that expert k's moves from cell c lead to, in an array of rows of ``size``. */
INLINE void rows_after(const Game *g, int64_t k, int64_t c, const double *array, int64_t size, const double **rows) {
  const int32_t *successor = g->successor + (k * g->cells + c) * g->moves;
  for (int64_t m = 0; m < g->moves; m++) rows[m] = array + successor[m] * size;
}

/* Experts N..2 move, while expert 1 has arrived in cell x: partial[N - 1], ..., partial[1] of this slab. */
INLINE void partials(const Game *g, Work *w, int64_t x, const double **rows) {
  for (int64_t k = g->experts - 1; k >= 1; k--) { /* expert k + 1 */
    int64_t inner = power(g->cells, g->experts - 1 - k), outer = w->slab / (inner * g->cells);
    for (int64_t o = 0; o < outer; o++) {
      int64_t start = x * w->slab + o * g->cells * inner;
      const double *from = w->partial[k + 1] + start;
      double *to = w->partial[k] + start;
      if (inner == 1) {
        shift_row(to, from, w->taps, g, 1);
        continue;
      }
      for (int64_t c = 0; c < g->cells; c++) {
        rows_after(g, k, c, from, inner, rows);
        combine(to + c * inner, rows, w->chances + (k * g->cells + c) * g->moves, g->moves, inner);
      }
    }
  }
}

/* Expert 1 moves from cell c, too: the sums of this slab, in w->mass. */
INLINE void slab_mass(const Game *g, Work *w, int64_t c, const double **rows) {
  rows_after(g, 0, c, w->partial[1], w->slab, rows);
  combine(w->mass, rows, w->chances + c * g->moves, g->moves, w->slab);
}

/* Corrects the sums of the coupled states of this slab; 0 where they are to be summed in logs. Slabs come in order, and
   some may be left out. */
INLINE void correct(const Game *g, Work *w, int64_t slab, const double *onward) {
  int64_t start = slab * w->slab, end = start + w->slab;
  while (w->next_coupled < g->coupled && g->coupled_states[w->next_coupled] < start) w->next_coupled++;
  for (; w->next_coupled < g->coupled && g->coupled_states[w->next_coupled] < end; w->next_coupled++) {
    double *sum = w->mass + (g->coupled_states[w->next_coupled] - start), least = MOST_TAKEN * *sum;
    while (w->next_way < g->ways && g->way_of[w->next_way] < w->next_coupled) w->next_way++;
    for (; w->next_way < g->ways && g->way_of[w->next_way] == w->next_coupled; w->next_way++) {
      const int32_t *entries = g->way_entries + w->next_way * g->experts;
      int64_t level = g->way_levels[w->next_way];
      double part = onward[g->way_after[w->next_way]];
      for (int64_t i = 0; i < g->experts; i++) part *= w->chances[entries[i]];
      *sum += (w->levels[level] - 1.0) * part;
      if (g->level_weights[level] > MOST_GAINED) least = INFINITY;
    }
    if (*sum < least) *sum = 0.0;
  }
}

INLINE double log_chance(const Game *g, const Work *w, int64_t entry) {
  int64_t row = entry / g->moves, expert = row / g->cells;
  return g->move_weights[entry] + g->discount * w->next_phi[expert * g->cells + g->successor[entry]] - w->phi[row];
}

/* All joint actions of a state: where they lead, and the products of the experts' p (sums of log p). */
INLINE void joint_actions_of(const Game *g, int64_t experts, int64_t moves, Work *w, int64_t state, int logarithms) {
  int64_t count = 1, block = w->slab;
  w->value[0] = logarithms ? 0.0 : 1.0;
  w->after[0] = 0;
  for (int64_t i = 0; i < experts; i++) {
    int64_t cell = state / block, entry = (i * g->cells + cell) * moves;
    for (int64_t a = count - 1; a >= 0; a--) {
      double value = w->value[a];
      int32_t after = w->after[a];
      for (int64_t m = moves - 1; m >= 0; m--) {
        w->value[a * moves + m] =
            logarithms ? value + log_chance(g, w, entry + m) : value * w->chances[entry + m];
        w->after[a * moves + m] = after + g->successor[entry + m] * (int32_t)block;
      }
    }
    state -= cell * block;
    block /= g->cells;
    count *= moves;
  }
}

INLINE void joint_actions(const Game *g, Work *w, int64_t state, int logarithms) {
  if (g->experts == 2 && g->moves == 4) joint_actions_of(g, 2, 4, w, state, logarithms);
  else joint_actions_of(g, g->experts, g->moves, w, state, logarithms);
}

/* The level of each joint action; 0 for a state that is not coupled, where it is 0 throughout. */
INLINE const uint8_t *levels_in(const Game *g, int64_t joint_actions, int64_t state) {
  int64_t low = 0, high = g->coupled;
  while (low < high) {
    int64_t middle = (low + high) / 2;
    if (g->coupled_states[middle] < state) low = middle + 1;
    else high = middle;
  }
  return low < g->coupled && g->coupled_states[low] == state ? g->coupled_levels + low * joint_actions : 0;
}

/* w->value: log(p exp(W) X) of each joint action; returns the logarithm of their sum. */
INLINE double sum_in_logs(const Game *g, Work *w, int64_t state, const double *gain, double shift) {
  const uint8_t *level = levels_in(g, w->actions, state);
  double largest = -INFINITY, sum = 0.0;
  joint_actions(g, w, state, 1);
  for (int64_t a = 0; a < w->actions; a++) {
    w->value[a] += (level ? g->level_weights[level[a]] : 0.0) + g->discount * (gain[w->after[a]] - shift);
    if (w->value[a] > largest) largest = w->value[a];
  }
  for (int64_t a = 0; a < w->actions; a++) sum += fixed_exp(w->value[a] - largest);
  return largest + fixed_log(sum);
}

#endif
