/* How probable trajectories are under the policy of independent experts (factored.h). */
#include "factored.h"

/* log pi_t(a | s): phi and gain of this step and, behind them, of the next. */
INLINE double log_chance_of(const Game *g, const double *phi, const double *gain, int64_t state, int64_t action) {
  const uint8_t *levels = levels_in(g, power(g->moves, g->experts), state);
  const double *next = phi + g->experts * g->cells;
  int64_t after = 0, block = 1, cells = state, moves = action;
  double alone[MOST_EXPERTS];
  for (int64_t i = g->experts - 1; i >= 0; i--, block *= g->cells, cells /= g->cells, moves /= g->moves) {
    int64_t row = i * g->cells + cells % g->cells, entry = row * g->moves + moves % g->moves;
    after += g->successor[entry] * block;
    alone[i] = g->move_weights[entry] + g->discount * next[i * g->cells + g->successor[entry]] - phi[row];
  }
  double sum = g->discount * gain[g->states + after];
  sum += g->level_weights[levels ? levels[action] : 0];
  sum += g->state_weights[state] - gain[state];
  for (int64_t i = 0; i < g->experts; i++) sum += alone[i];
  return sum;
}

/* Of each of ``count`` trajectories, states and actions [count][T + 1]: the sum of log pi_t(a | s) while it is under way,
   which it is not where ``goal`` [state] says so. */
KERNEL int mabirds_factored_likelihood(const Game *g, const double *phi, const double *gain, const uint8_t *goal,
                                       const int64_t *states, const int64_t *actions, int64_t count, double *sums) {
  for (int64_t k = 0; k < count; k++) {
    sums[k] = 0.0;
    for (int64_t t = 0; t <= g->horizon; t++, states++, actions++)
      if (!goal[*states])
        sums[k] += log_chance_of(g, phi + t * g->experts * g->cells, gain + t * g->states, *states, *actions);
  }
  return 0;
}
