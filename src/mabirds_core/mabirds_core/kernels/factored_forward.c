/* Where the policy of independent experts goes, forwards in time: the transpose of the backward pass (factored.h). */
#include "factored.h"

/* 1 for what a trajectory may touch, 0 for what it must not: mass that does is lost. No such arrays: all may be. */
typedef struct {
  const double *moves;  /* [expert][cell][move] */
  const double *states; /* [state] */
  const double *levels; /* [level] */
} Kept;

/* gamma^t-weighted sums of probabilities. None: nobody asks for them. */
typedef struct {
  double *moves;  /* [expert][cell][move] */
  double *states; /* [state] */
  double *levels; /* [level], in coupled states */
} Totals;

typedef struct {
  double weight;          /* gamma^t */
  double *flow;           /* P, then P / sum: [state], padded */
  double *moved;          /* expert 1 has moved: [state], padded */
  double *one, *other;    /* further experts have moved: [slab], padded */
  double *kept_chances;   /* p where kept */
  double *kept_taps;      /* [offsets][cell], by where one comes from */
  double *dots;           /* [offsets][cell] */
  double *apart;          /* of states that are left action by action: P / sum, or -P where the sum is too small */
  int32_t *apart_states;
  const uint8_t **apart_levels; /* of their joint actions, or 0 */
  int64_t n_apart;
  uint8_t *active, *reached; /* [cell] of expert 1 */
} Flow;

INLINE void prepare_flow(const Game *g, const Work *w, double *rest, Flow *f) {
  f->flow = take(&rest, g->states + 2 * g->cells) + g->cells;
  f->moved = take(&rest, g->states + 2 * g->cells) + g->cells;
  f->one = take(&rest, w->slab + 2 * g->cells) + g->cells;
  f->other = take(&rest, w->slab + 2 * g->cells) + g->cells;
  f->kept_chances = take(&rest, g->experts * g->cells * g->moves);
  f->kept_taps = take(&rest, g->offsets * g->cells);
  f->dots = take(&rest, g->offsets * g->cells);
  f->apart = take(&rest, g->states);
  f->apart_states = (int32_t *)take(&rest, g->states);
  f->apart_levels = (const uint8_t **)take(&rest, g->states);
  f->active = (uint8_t *)take(&rest, g->cells);
  f->reached = (uint8_t *)take(&rest, g->cells);
}

INLINE int64_t flow_size(const Game *g) {
  int64_t slab = g->states / g->cells;
  return 5 * g->states + 2 * slab + 8 * g->cells + g->experts * g->cells * g->moves + 2 * g->offsets * g->cells +
         2 * g->cells;
}

INLINE void step_kept(const Game *g, const Work *w, const Kept *kept, Flow *f) {
  int64_t size = g->experts * g->cells * g->moves;
  for (int64_t k = 0; k < size; k++) f->kept_chances[k] = kept ? w->chances[k] * kept->moves[k] : w->chances[k];
  step_taps(g, f->kept_chances, f->dots);
  for (int64_t o = 0; o < g->offsets; o++)
    for (int64_t y = 0; y < g->cells; y++) {
      int64_t c = y - g->offset[o];
      f->kept_taps[o * g->cells + y] = c >= 0 && c < g->cells ? f->dots[o * g->cells + c] : 0.0;
    }
}

/* to += p from. */
INLINE void add_row(double *restrict to, const double *restrict from, double p, int64_t size) {
  for (int64_t j = 0; j < size; j++) to[j] += p * from[j];
}

INLINE double dot(const double *a, const double *b, int64_t size) {
  lanes one = {0.0}, two = {0.0};
  int64_t j = 0;
  for (; j + 8 <= size; j += 8) {
    one += LANES(a + j) * LANES(b + j);
    two += LANES(a + j + 4) * LANES(b + j + 4);
  }
  lanes sum = one + two;
  double total = (sum[0] + sum[1]) + (sum[2] + sum[3]);
  for (; j < size; j++) total += a[j] * b[j];
  return total;
}

/* States that may be are counted, and slabs where nobody is are left out. Mass below
   exp(-cut) is given up, so that no product leaves the range of normal numbers. */
INLINE void begin_step(const Game *g, const Work *w, const Kept *kept, Flow *f, Totals *totals) {
  double floor = fixed_exp(-w->cut), weight = f->weight;
  for (int64_t c = 0; c < g->cells; c++) {
    if (!f->active[c]) continue;
    double *restrict flow = f->flow + c * w->slab, *restrict counted = totals ? totals->states + c * w->slab : 0;
    int64_t any = 0;
    for (int64_t j = 0; kept && j < w->slab; j++) flow[j] *= kept->states[c * w->slab + j];
    for (int64_t j = 0; j < w->slab; j++) {
      double here = flow[j] < floor ? 0.0 : flow[j];
      any |= here > 0.0;
      flow[j] = here;
      if (totals) counted[j] += weight * here;
    }
    f->active[c] = any != 0;
  }
}

INLINE void mark_reached(const Game *g, Flow *f) {
  for (int64_t c = 0; c < g->cells; c++) f->reached[c] = 0;
  for (int64_t c = 0; c < g->cells; c++)
    for (int64_t m = 0; f->active[c] && m < g->moves; m++) f->reached[g->successor[c * g->moves + m]] = 1;
}

INLINE void set_apart(const Work *w, Flow *f, int64_t state, double sum, const uint8_t *levels) {
  double mass = f->flow[state];
  if (!(mass > 0.0)) return;
  f->apart[f->n_apart] = sum < w->least ? -mass : mass / sum;
  f->apart_levels[f->n_apart] = levels;
  f->apart_states[f->n_apart++] = (int32_t)state;
  f->flow[state] = 0.0;
}

/* P / sum; coupled states, and those whose sums are too small to divide by, are set apart. */
INLINE void divide(const Game *g, const Work *w, Flow *f, int64_t start, int64_t first_coupled) {
  double *restrict flow = f->flow + start, least = w->least;
  const double *restrict mass = w->mass;
  int64_t small = 0;
  for (int64_t k = first_coupled; k < w->next_coupled; k++) {
    int64_t state = g->coupled_states[k];
    if (state >= start) set_apart(w, f, state, mass[state - start], g->coupled_levels + k * w->actions);
  }
  for (int64_t j = 0; j < w->slab; j++) small |= (flow[j] > 0.0) & (mass[j] < least);
  for (int64_t j = 0; small && j < w->slab; j++)
    if (mass[j] < least) set_apart(w, f, start + j, mass[j], 0);
  for (int64_t j = 0; j < w->slab; j++) {
    double ratio = flow[j] / mass[j];
    flow[j] = mass[j] < least ? 0.0 : ratio;
  }
}

/* Expert 1 moves from all cells where it is. */
INLINE void first_moves(const Game *g, Work *w, Flow *f, Totals *totals, const double **rows) {
  for (int64_t x = 0; x < g->cells; x++) {
    double *moved = f->moved + x * w->slab;
    if (!f->reached[x]) continue;
    for (int64_t j = 0; j < w->slab; j++) moved[j] = 0.0;
  }
  for (int64_t c = 0; c < g->cells; c++) {
    if (!f->active[c]) continue;
    double *flow = f->flow + c * w->slab;
    int64_t first_coupled = w->next_coupled;
    slab_mass(g, w, c, rows);
    correct(g, w, c, w->partial[g->experts]);
    divide(g, w, f, c * w->slab, first_coupled);
    for (int64_t m = 0; m < g->moves; m++) {
      int64_t entry = c * g->moves + m;
      if (totals) totals->moves[entry] += f->weight * w->chances[entry] * dot(flow, rows[m], w->slab);
      add_row(f->moved + g->successor[entry] * w->slab, flow, f->kept_chances[entry], w->slab);
    }
  }
}

/* dots[o] += from * onward shifted by offset o, a row of cells. */
INLINE void add_products(double *restrict dots, const double *restrict from, const double *restrict onward,
                         const int32_t *offset, int64_t offsets, int64_t cells) {
  for (int64_t o = 0; o < offsets; o++)
    for (int64_t c = 0; c < cells; c++) dots[o * cells + c] += from[c] * onward[c + offset[o]];
}

/* Expert k + 1, not the first and not the last, moves in ``cells`` rows of ``inner`` states. */
INLINE void middle_moves(const Game *g, Work *w, Flow *f, Totals *totals, int64_t k, int64_t inner, const double *from,
                         double *to, const double *onward) {
  for (int64_t j = 0; j < g->cells * inner; j++) to[j] = 0.0;
  for (int64_t c = 0; c < g->cells; c++)
    for (int64_t m = 0; m < g->moves; m++) {
      int64_t entry = (k * g->cells + c) * g->moves + m, after = g->successor[entry] * inner;
      if (totals) totals->moves[entry] += f->weight * w->chances[entry] * dot(from + c * inner, onward + after, inner);
      add_row(to + after, from + c * inner, f->kept_chances[entry], inner);
    }
}

/* Experts 2..N move, expert 1 has arrived in cell x: P of the next step in this slab. */
INLINE void further_moves(const Game *g, Work *w, Flow *f, Totals *totals, int64_t x, double least) {
  double *from = f->moved + x * w->slab, *to = f->one;
  for (int64_t k = 1; k < g->experts; k++) {
    int64_t inner = power(g->cells, g->experts - 1 - k), block = inner * g->cells;
    for (int64_t start = 0; start < w->slab; start += block) {
      const double *onward = w->partial[k + 1] + x * w->slab + start;
      if (inner == 1) {
        if (totals) add_products(f->dots, from + start, onward, g->offset, g->offsets, g->cells);
        shift_row(to + start, from + start, f->kept_taps, g, -1);
      } else {
        middle_moves(g, w, f, totals, k, inner, from + start, to + start, onward);
      }
    }
    from = to;
    to = to == f->one ? f->other : f->one;
  }
  const double *onward = w->partial[g->experts] + x * w->slab;
  double *flow = f->flow + x * w->slab;
  for (int64_t j = 0; j < w->slab; j++) flow[j] = from[j] < least ? 0.0 : from[j] * onward[j];
}

/* Totals of the last expert's moves from sums by where they lead. */
INLINE void count_last(const Game *g, Work *w, Flow *f, Totals *totals) {
  int64_t rows = (g->experts - 1) * g->cells;
  for (int64_t c = 0; c < g->cells && g->experts > 1; c++)
    for (int64_t m = 0; m < g->moves; m++) {
      int64_t entry = (rows + c) * g->moves + m;
      totals->moves[entry] += f->weight * w->chances[entry] * f->dots[g->offset_of[c * g->moves + m] * g->cells + c];
    }
}

/* One state, action by action: w->value has the chances of the actions, but for the factor ``mass``. */
INLINE void spread_state_of(const Game *g, int64_t experts, int64_t moves, const Work *w, const Kept *kept, Flow *f,
                            Totals *totals, int64_t state, double mass, const uint8_t *level) {
  int64_t entry[MOST_EXPERTS], block = w->slab, actions = power(moves, experts);
  double *flow = f->flow, weight = f->weight;
  for (int64_t i = 0; i < experts; i++) {
    entry[i] = (i * g->cells + state / block) * moves;
    state %= block;
    block /= g->cells;
  }
  for (int64_t a = 0; a < actions; a++) {
    const int32_t *digits = w->digits + a * experts;
    double part = mass * w->value[a], counted = weight * part;
    for (int64_t i = 0; i < experts; i++) {
      if (totals) totals->moves[entry[i] + digits[i]] += counted;
      if (kept) part *= kept->moves[entry[i] + digits[i]];
    }
    if (level && level[a]) {
      if (totals) totals->levels[level[a]] += counted;
      if (kept) part *= kept->levels[level[a]];
    }
    flow[w->after[a]] += part;
  }
}

INLINE void spread_state(const Game *g, const Work *w, const Kept *kept, Flow *f, Totals *totals, int64_t state,
                         double mass, const uint8_t *level) {
  if (g->experts == 2 && g->moves == 4) spread_state_of(g, 2, 4, w, kept, f, totals, state, mass, level);
  else spread_state_of(g, g->experts, g->moves, w, kept, f, totals, state, mass, level);
}

/* w->value: p exp(W) X of each joint action. */
INLINE void products(const Game *g, Work *w, int64_t state, const uint8_t *level) {
  const double *onward = w->partial[g->experts];
  joint_actions(g, w, state, 0);
  for (int64_t a = 0; a < w->actions; a++) {
    w->value[a] *= onward[w->after[a]];
    if (level && level[a]) w->value[a] *= w->levels[level[a]];
  }
}

INLINE void moves_apart(const Game *g, Work *w, const Kept *kept, Flow *f, Totals *totals, const double *gain,
                        double shift) {
  for (int64_t k = 0; k < f->n_apart; k++) {
    int64_t state = f->apart_states[k];
    double mass = f->apart[k];
    if (mass > 0.0) {
      products(g, w, state, f->apart_levels[k]);
    } else {
      double log_sum = sum_in_logs(g, w, state, gain, shift);
      for (int64_t a = 0; a < w->actions; a++) w->value[a] = fixed_exp(w->value[a] - log_sum);
      mass = -mass;
    }
    spread_state(g, w, kept, f, totals, state, mass, f->apart_levels[k]);
  }
  f->n_apart = 0;
}

INLINE void advance(const Game *g, Work *w, Flow *f, Totals *totals, const double **rows) {
  double least = fixed_exp(-w->cut * (double)g->experts);
  mark_reached(g, f);
  for (int64_t x = 0; x < g->cells; x++)
    if (f->reached[x]) partials(g, w, x, rows);
  first_moves(g, w, f, totals, rows);
  for (int64_t k = 0; k < g->offsets * g->cells; k++) f->dots[k] = 0.0;
  for (int64_t x = 0; x < g->cells; x++) {
    if (f->reached[x]) further_moves(g, w, f, totals, x, least);
    else if (f->active[x])
      for (int64_t j = 0; j < w->slab; j++) f->flow[x * w->slab + j] = 0.0;
  }
  for (int64_t x = 0; x < g->cells; x++) f->active[x] = f->reached[x];
  if (totals) count_last(g, w, f, totals);
}

INLINE double total_mass(const Game *g, const double *flow) {
  double total = 0.0;
  for (int64_t s = 0; s < g->states; s++) total += flow[s];
  return total;
}

/* What is left after step T; negative: no memory. */
INLINE double follow(const Game *g, const double *phi, const double *chances, const double *gain, double *onward,
                     const double *shift, const double *start, const Kept *kept, Totals *totals) {
  Work work, *w = &work;
  Flow flow, *f = &flow;
  const double *rows[MOST_MOVES];
  double *rest;
  if (!prepare(g, w, flow_size(g), &rest)) return -1.0;
  prepare_flow(g, w, rest, f);
  for (int64_t s = 0; s < g->states; s++) f->flow[s] = start[s];
  for (int64_t c = 0; c < g->cells; c++) f->active[c] = 1;
  f->weight = 1.0;
  f->n_apart = 0;
  for (int64_t t = 0; t <= g->horizon; t++) {
    begin(g, w, t, phi, chances, onward);
    step_kept(g, w, kept, f);
    begin_step(g, w, kept, f, totals);
    advance(g, w, f, totals, rows);
    moves_apart(g, w, kept, f, totals, gain + (t + 1) * g->states, shift[t + 1]);
    f->weight *= g->discount;
  }
  double mass = total_mass(g, f->flow);
  free(w->block);
  return mass;
}

/* ``phi``, ``chances``, ``gain``, ``onward`` and ``shift`` are the backward pass's, ``start`` is [state], totals begin as
   0. Returns 0, or 1 without memory. */
KERNEL int mabirds_factored_forward(const Game *g, const double *phi, const double *chances, const double *gain,
                                    double *onward, const double *shift, const double *start, Totals *totals) {
  return follow(g, phi, chances, gain, onward, shift, start, 0, totals) < 0.0;
}

/* The same without totals. Mass that touches what is not kept is lost; ``mass`` becomes what is left. */
KERNEL int mabirds_factored_remaining(const Game *g, const double *phi, const double *chances, const double *gain,
                                      double *onward, const double *shift, const double *start, const Kept *kept,
                                      double *mass) {
  *mass = follow(g, phi, chances, gain, onward, shift, start, kept, 0);
  return *mass < 0.0;
}
