/* Soft values of independent experts, backwards in time (factored.h). */
#include "factored.h"

/* phi_t(c) = log sum_m exp(w(c, m) + gamma phi_t+1(c')) of each expert alone, and p of its moves, 0 below exp(-cut);
   ``scratch`` is [expert][cell]. */
INLINE void alone_some(const Game *g, int64_t moves, double cut, const double *next, double *restrict phi,
                       double *restrict chances, double *restrict scratch) {
  int64_t rows = g->experts * g->cells, size = rows * moves;
  for (int64_t row = 0; row < rows; row++) {
    const double *of_expert = next + row / g->cells * g->cells;
    double largest = -INFINITY;
    for (int64_t k = row * moves; k < (row + 1) * moves; k++) {
      chances[k] = g->move_weights[k] + g->discount * of_expert[g->successor[k]];
      largest = chances[k] > largest ? chances[k] : largest;
    }
    for (int64_t k = row * moves; k < (row + 1) * moves; k++) chances[k] -= largest;
    scratch[row] = largest;
  }
  for (int64_t k = 0; k < size; k++) chances[k] = fixed_exp(chances[k]);
  for (int64_t row = 0; row < rows; row++) {
    phi[row] = 0.0;
    for (int64_t m = 0; m < moves; m++) phi[row] += chances[row * moves + m];
    for (int64_t m = 0; m < moves; m++) {
      double chance = chances[row * moves + m] / phi[row];
      chances[row * moves + m] = chance < cut ? 0.0 : chance;
    }
  }
  for (int64_t row = 0; row < rows; row++) phi[row] = scratch[row] + fixed_log(phi[row]);
}

INLINE void alone(const Game *g, double cut, const double *next, double *phi, double *chances, double *scratch) {
  if (g->moves == 4) alone_some(g, 4, cut, next, phi, chances, scratch); /* lets the compiler unroll */
  else alone_some(g, g->moves, cut, next, phi, chances, scratch);
}

/* Gains of the slab whose sums are in w->mass. */
INLINE void slab_gains(const Work *w, const double *of_state, double constant, double *gain) {
  for (int64_t j = 0; j < w->slab; j++) gain[j] = (of_state[j] + constant) + fixed_log(w->mass[j]);
}

INLINE int any_below(const double *values, int64_t size, double least) {
  int64_t below = 0;
  for (int64_t j = 0; j < size; j++) below |= values[j] < least;
  return below != 0;
}

INLINE double largest_of(const double *values, int64_t size) {
  double largest = values[0];
  int64_t j = 0;
  if (size >= 4) {
    lanes most = LANES(values);
    for (; j + 4 <= size; j += 4) {
      lane_bits more = LANES(values + j) > most;
      most = (lanes)((more & (lane_bits)LANES(values + j)) | (~more & (lane_bits)most));
    }
    for (int64_t k = 0; k < 4; k++) largest = most[k] > largest ? most[k] : largest;
  }
  for (; j < size; j++) largest = values[j] > largest ? values[j] : largest;
  return largest;
}

/* G_t of all states; returns the largest. */
INLINE double gains(const Game *g, Work *w, const double *next_gain, double shift, double *gain) {
  const double *rows[MOST_MOVES];
  double largest = -INFINITY, constant = g->discount * shift;
  for (int64_t x = 0; x < g->cells; x++) partials(g, w, x, rows);
  for (int64_t c = 0; c < g->cells; c++) {
    int64_t start = c * w->slab;
    slab_mass(g, w, c, rows);
    correct(g, w, c, w->partial[g->experts]);
    slab_gains(w, g->state_weights + start, constant, gain + start);
    if (any_below(w->mass, w->slab, w->least))
      for (int64_t j = 0; j < w->slab; j++)
        if (w->mass[j] < w->least)
          gain[start + j] = (g->state_weights[start + j] + constant) + sum_in_logs(g, w, start + j, next_gain, shift);
    double of_slab = largest_of(gain + start, w->slab);
    largest = of_slab > largest ? of_slab : largest;
  }
  return largest;
}

/* X = exp(gamma (G - shift)). */
INLINE void onward_of(const Game *g, const Work *w, const double *gain, double shift, double *onward) {
  for (int64_t s = 0; s < g->states; s++) {
    double exponent = g->discount * (gain[s] - shift);
    double value = fixed_exp(exponent);
    onward[s] = exponent < -w->cut ? 0.0 : value;
  }
}

/* phi: [T + 2][expert][cell]; chances: p, [T + 1][expert][cell][move]; gain: [T + 2][state]; shift: [T + 2];
   onward: X, [T + 2][state] with ``cells`` more at both ends, finite there. Returns 0, or 1 without memory. */
KERNEL int mabirds_factored_backward(const Game *g, double *phi, double *chances, double *gain, double *onward,
                                     double *shift) {
  Work work, *w = &work;
  double *scratch;
  int64_t rows = g->experts * g->cells, last = g->horizon + 1;
  if (!prepare(g, w, rows, &scratch)) return 1;
  double least = fixed_exp(-w->cut);
  for (int64_t k = 0; k < rows; k++) phi[last * rows + k] = 0.0;
  for (int64_t s = 0; s < g->states; s++) gain[last * g->states + s] = 0.0, onward[last * g->states + s] = 1.0;
  shift[last] = 0.0;
  for (int64_t t = g->horizon; t >= 0; t--) {
    double *own_gain = gain + t * g->states, *own_onward = onward + t * g->states;
    for (int64_t k = 1; k <= g->cells; k++) own_onward[g->states - k] = 0.0; /* read with weight 0 before it is known */
    alone(g, least, phi + (t + 1) * rows, phi + t * rows, chances + t * rows * g->moves, scratch);
    begin(g, w, t, phi, chances, onward);
    shift[t] = gains(g, w, own_gain + g->states, shift[t + 1], own_gain);
    onward_of(g, w, own_gain, shift[t], own_onward);
  }
  free(w->block);
  return 0;
}
