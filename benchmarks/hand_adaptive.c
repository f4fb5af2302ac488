/* One rollout of the paper's Case 4 with dualwinch's adaptive exponential method, written by hand: the limit for that
   method and its accuracy, one thread and no vector lanes. An independent implementation of what docs/accuracy.md
   describes: where both ropes surely stay taut and the rail friction does not bend, a sample is one step; elsewhere it
   is several, each with ropes that go slack and tight. A good engineer's choices: each rope's state is its stretch and
   the stretch's rate, not the drum's angle; the mid-step speed is predicted with the slow acceleration of the last step;
   branches are only taken where a rope is slack; nothing is done for the winch friction Case 4 has not. */

#include "hand_case.h"

/* A rope with its drum: s'' = drive -+ a - mobility (spring s + damper s'), taut; without the bracket, slack. */
struct rope {
  double stretch, rate, length, spring, drive, stiffening;
};

struct drum {
  double damper, mobility, per_mobility, motor, damping, share;
};

/* Flow of a taut rope over a step. What swings is the stretch times the relative stiffness, 1 at mid-step: its flow
   ff fr rf rr, what a unit of drive adds to it; the relative stiffness at the start, its inverse at the end, its rate. */
struct flow {
  double ff, fr, rf, rr, drive, start, end, stiffening;
};

static struct drum prepare_drum(double stiffness, double damper, double radius, double inertia, double gear) {
  struct drum d;
  d.damper = damper;
  d.mobility = radius * radius / inertia;
  d.per_mobility = 1 / d.mobility;
  d.motor = radius * gear / inertia;
  d.damping = d.mobility * damper;
  d.share = damper * d.damping / stiffness;
  return d;
}

/* cos(r) and sin(r)/r, to rounding up to two oscillations, from r * r, which may be negative: series for r/8, doubled. */
static inline void cosine_and_sine(double square, double *cosine, double *sine) {
  double q = -square / 64, c = 1 / 20922789888000.0, s = 1 / 355687428096000.0;
  c = c * q + 1 / 87178291200.0;
  s = s * q + 1 / 1307674368000.0;
  c = c * q + 1 / 479001600.0;
  s = s * q + 1 / 6227020800.0;
  c = c * q + 1 / 3628800.0;
  s = s * q + 1 / 39916800.0;
  c = c * q + 1 / 40320.0;
  s = s * q + 1 / 362880.0;
  c = c * q + 1 / 720.0;
  s = s * q + 1 / 5040.0;
  c = c * q + 1 / 24.0;
  s = s * q + 1 / 120.0;
  c = c * q + 0.5;
  s = s * q + 1 / 6.0;
  c = c * q + 1;
  s = s * q + 1;
  for (int doubling = 0; doubling < 3; ++doubling) {
    s *= c;
    c = 2 * c * c - 1;
  }
  *cosine = c;
  *sine = s;
}

static inline struct flow taut_flow(double spring, double stiffening, const struct drum *d, double h) {
  double delta = d->damping - 2 * stiffening, kappa = d->mobility * spring - d->damping * stiffening;
  double cosine, sine, decay = exp(-delta * h / 2);
  cosine_and_sine((kappa - delta * delta / 4) * h * h, &cosine, &sine);
  double even = decay * cosine, odd = decay * sine * h, skew = delta / 2 * odd;
  double half = stiffening * h / 2, grown = 1 + half, both = 1 / (kappa * grown);
  struct flow f;
  f.ff = even + skew;
  f.fr = odd;
  f.rf = -kappa * odd;
  f.rr = even - skew;
  f.drive = (1 - f.ff) * (grown * both);
  f.start = 1 - half;
  f.end = kappa * both;
  f.stiffening = stiffening;
  return f;
}

/* Stretch and rate after the step under the drive g. */
static inline void carry(const struct flow *f, double *stretch, double *rate, double g) {
  double force = f->start * *stretch, gain = f->start * *rate + f->stiffening * *stretch;
  *stretch = (f->ff * force + f->fr * gain + f->drive * g) * f->end;
  *rate = (f->rf * force + f->rr * gain + f->fr * g - f->stiffening * *stretch) * f->end;
}

/* What a unit of drive adds to both. */
static inline void yield_to(const struct flow *f, double *stretch, double *rate) {
  *stretch = f->drive * f->end;
  *rate = (f->fr - f->stiffening * *stretch) * f->end;
}

static inline double pull(const struct rope *r, const struct drum *d, double stretch, double rate) {
  return r->spring * stretch + d->damper * rate;
}

static inline int is_taut(const struct rope *r, const struct drum *d, double stretch, double rate) {
  return stretch > 0 && pull(r, d, stretch, rate) > 0;
}

/* Whether the rope surely stays taut all through the step: the swing about the equilibrium, as if undamped, leaves
   spring (equilibrium - amplitude) > damper sqrt(kappa) amplitude, squared so that no root or division is left. */
static inline int stays_taut(const struct rope *r, const struct drum *d, double g) {
  double kappa = d->mobility * r->spring, off = kappa * r->stretch - g;
  double amplitude_square = 1.1 * (off * off + kappa * r->rate * r->rate);
  return g > 0 && g * g > (1.25 + 5 * d->share * r->length) * amplitude_square;
}

/* Moment in [0, h] at which a parabola given by start, slope there and end changes its sign. */
static double crossing(double start, double slope, double end, double h) {
  double bend = 2 * (end - start - slope * h) / (h * h);
  double root = sqrt(larger(slope * slope - 2 * bend * start, 0));
  double towards = (start > 0 ? -slope : slope) + root;
  return towards > 0 ? clip(2 * fabs(start) / towards, 0, h) : start == 0 ? 0 : h;
}

static void fly(double *stretch, double *rate, double g, double t) {
  *stretch += t * (*rate + t / 2 * g);
  *rate += t * g;
}

/* A taut rope over a part of a step, by its power series. */
static void swing(double *stretch, double *rate, double g, double t, const struct rope *r, const struct drum *d) {
  double kappa = d->mobility * r->spring, first = *rate;
  double second = g - kappa * *stretch - d->damping * first, power = t;
  *stretch += t * first;
  for (int order = 2; order <= 8; ++order) {
    *rate += second * power;
    power *= t / order;
    *stretch += second * power;
    double third = -kappa * first - d->damping * second;
    first = second;
    second = third;
  }
}

/* The rest of a step in which a rope goes slack or tight; *stretch and *rate hold its end without that. */
static void switched(const struct rope *r, const struct drum *d, int taut, double g, double h, double *stretch,
                     double *rate) {
  double force = pull(r, d, r->stretch, r->rate);
  double slope = r->spring * r->rate + d->damper * (g - (taut ? d->mobility * force : 0));
  double by_force = crossing(force, slope, pull(r, d, *stretch, *rate), h);
  double by_stretch = crossing(r->stretch, r->rate, *stretch, h);
  double s = r->stretch, v = r->rate;
  if (taut) {
    swing(&s, &v, g, by_force, r, d);
    double missing = pull(r, d, s, v), curve = g - d->mobility * missing, fall = r->spring * v + d->damper * curve;
    double later = fall < 0 ? clip(-missing / fall, -by_force, h - by_force) : 0;
    s += later * (v + later * curve / 2);
    v += later * curve;
    fly(&s, &v, g, h - by_force - later);
  } else {
    double when = larger(r->stretch > 0 ? 0 : by_stretch, force > 0 ? 0 : by_force);
    fly(&s, &v, g, when);
    swing(&s, &v, g, h - when, r, d);
  }
  *stretch = s;
  *rate = v;
}

/* End of a step for a rope that may go slack or tight; returns its impulse. */
static double rope_end(struct rope *r, const struct drum *d, const struct flow *f, int taut, double g, double h) {
  double stretch = r->stretch, rate = r->rate;
  if (taut) {
    carry(f, &stretch, &rate, g);
  } else {
    fly(&stretch, &rate, g, h);
  }
  if (taut != is_taut(r, d, stretch, rate)) switched(r, d, taut, g, h, &stretch, &rate);
  double impulse = (h * g - (rate - r->rate)) * d->per_mobility;
  r->stretch = stretch;
  r->rate = rate;
  return impulse;
}

/* Acceleration of the vehicle by all but the ropes. */
static inline double slow_acceleration(double t, double v, const struct plant *c) {
  double drag = c->drag * v * fabs(v);
  double friction = c->friction * tanh(v * c->per_friction_velocity);
  return (drag * (c->vortex * sin(c->shedding * v * t) - 1) - friction) * c->per_mass;
}

struct state {
  double x, v, slow; /* slow: acceleration by all but the ropes amid the last step */
  struct rope r1, r2;
};

static inline void at_middle(struct state *y, const struct plant *c, double h) {
  double x = y->x + h / 2 * y->v;
  y->r1.length = larger(c->longest_1 - x, SHORTEST);
  y->r2.length = larger(x + c->rope_offset, SHORTEST);
  double both = 1 / (y->r1.length * y->r2.length), per_1 = y->r2.length * both, per_2 = y->r1.length * both;
  y->r1.spring = c->stiffness_1 * per_1;
  y->r2.spring = c->stiffness_2 * per_2;
  y->r1.stiffening = y->v * per_1;
  y->r2.stiffening = -y->v * per_2;
}

/* Several steps over a sample, ropes slack or taut. */
static void careful(struct state *y, const struct plant *c, const struct drum *d1, const struct drum *d2, double t,
                    double h, long substeps) {
  const double momentum = h / c->per_mass, per_momentum = 1 / momentum;
  for (long i = 0; i < substeps; ++i, t += h) {
    at_middle(y, c, h);
    struct rope *r1 = &y->r1, *r2 = &y->r2;
    struct flow f1 = {0}, f2 = {0};
    int taut_1 = is_taut(r1, d1, r1->stretch, r1->rate), taut_2 = is_taut(r2, d2, r2->stretch, r2->rate);
    double fixed = 0, divisor = momentum;
    if (taut_1) {
      f1 = taut_flow(r1->spring, r1->stiffening, d1, h);
      double stretch = r1->stretch, rate = r1->rate, by_stretch, by_rate;
      carry(&f1, &stretch, &rate, r1->drive);
      yield_to(&f1, &by_stretch, &by_rate);
      fixed += (h * r1->drive + r1->rate - rate) * d1->per_mobility;
      divisor += (h - by_rate) * d1->per_mobility;
    }
    if (taut_2) {
      f2 = taut_flow(r2->spring, r2->stiffening, d2, h);
      double stretch = r2->stretch, rate = r2->rate, by_stretch, by_rate;
      carry(&f2, &stretch, &rate, r2->drive);
      yield_to(&f2, &by_stretch, &by_rate);
      fixed -= (h * r2->drive + r2->rate - rate) * d2->per_mobility;
      divisor += (h - by_rate) * d2->per_mobility;
    }
    double v = y->v + h / 2 * (momentum * y->slow + fixed) / divisor;
    double slow = slow_acceleration(t + h / 2, v, c);
    double a = (momentum * slow + fixed) / divisor;
    double impulse = rope_end(r1, d1, &f1, taut_1, r1->drive - a, h) - rope_end(r2, d2, &f2, taut_2, r2->drive + a, h);
    double late = slow + impulse * per_momentum - a;
    y->x += h * (y->v + h / 2 * (a + late));
    y->v += h * (a + late);
    y->slow = slow;
    r1->stretch -= h * h / 2 * late; /* the vehicle moves on, the drums stay */
    r1->rate -= h * late;
    r2->stretch += h * h / 2 * late;
    r2->rate += h * late;
  }
}

/* One step over a sample with both ropes taut; 0, and nothing done, where that is not good enough. */
static inline int single(struct state *y, const struct plant *c, const struct drum *d1, const struct drum *d2, double t,
                         double h) {
  at_middle(y, c, h);
  struct rope *r1 = &y->r1, *r2 = &y->r2;
  struct flow f1 = taut_flow(r1->spring, r1->stiffening, d1, h), f2 = taut_flow(r2->spring, r2->stiffening, d2, h);
  double momentum = h / c->per_mass;
  double s1 = r1->stretch, v1 = r1->rate, s2 = r2->stretch, v2 = r2->rate;
  double stretch_1, rate_1, stretch_2, rate_2;
  carry(&f1, &s1, &v1, r1->drive);
  carry(&f2, &s2, &v2, r2->drive);
  yield_to(&f1, &stretch_1, &rate_1);
  yield_to(&f2, &stretch_2, &rate_2);
  double fixed = (h * r1->drive + r1->rate - v1) * d1->per_mobility - (h * r2->drive + r2->rate - v2) * d2->per_mobility;
  double per_divisor = 1 / (momentum + (h - rate_1) * d1->per_mobility + (h - rate_2) * d2->per_mobility);
  double v = y->v + h / 2 * (momentum * y->slow + fixed) * per_divisor;
  double slow = slow_acceleration(t + h / 2, v, c);
  double a = (momentum * slow + fixed) * per_divisor, end = y->v + h * a;

  double least = y->v * end > 0 ? smaller(fabs(y->v), fabs(end)) : 0;
  if (!(least * c->per_friction_velocity > 3 || fabs(end - y->v) * c->per_friction_velocity < 0.02)) return 0;
  if (!(stays_taut(r1, d1, r1->drive - a) && stays_taut(r2, d2, r2->drive + a))) return 0;
  y->x += h * (y->v + h / 2 * a);
  y->v = end;
  y->slow = slow;
  r1->stretch = s1 - stretch_1 * a;
  r1->rate = v1 - rate_1 * a;
  r2->stretch = s2 + stretch_2 * a;
  r2->rate = v2 + rate_2 * a;
  return 1;
}

/* Runs `samples` samples from `start`; `positions` (one after each sample) may be null. */
void hand_adaptive(const struct parameters *p, const struct sample *reference, long samples, long substeps,
                   struct motion *start, struct sums *sums, double *positions) {
  const struct plant c = prepare(p);
  const struct law g = prepare_law(p);
  const struct winch w1 = prepare_winch(p->drum_radius_1, p->gear_ratio_1, p->inertia_1, p->kp_1, p->ki_1, p);
  const struct winch w2 = prepare_winch(p->drum_radius_2, p->gear_ratio_2, p->inertia_2, p->kp_2, p->ki_2, p);
  const struct drum d1 = prepare_drum(c.stiffness_1, c.damping_1, c.radius_1, p->inertia_1, p->gear_ratio_1);
  const struct drum d2 = prepare_drum(c.stiffness_2, c.damping_2, c.radius_2, p->inertia_2, p->gear_ratio_2);
  const double h = p->sample_time;
  struct state y = {start->x, start->v, 0, {0}, {0}};
  y.r1.stretch = c.radius_1 * start->theta_1 - y.x;
  y.r1.rate = c.radius_1 * start->omega_1 - y.v;
  y.r2.stretch = c.radius_2 * start->theta_2 + y.x;
  y.r2.rate = c.radius_2 * start->omega_2 + y.v;
  struct controller s = {0};
  struct sums m = {0};
  m.least = 1e300;
  for (long n = 0; n < samples; ++n) {
    const double t = n * h;
    double length_1 = larger(c.longest_1 - y.x, SHORTEST), length_2 = larger(y.x + c.rope_offset, SHORTEST);
    double both = 1 / (length_1 * length_2);
    double F1 = c.stiffness_1 * length_2 * both * y.r1.stretch + c.damping_1 * y.r1.rate;
    double F2 = c.stiffness_2 * length_1 * both * y.r2.stretch + c.damping_2 * y.r2.rate;
    struct measurement measured;
    measured.x = y.x;
    measured.v = y.v;
    measured.omega_1 = (y.r1.rate + y.v) * w1.per_radius;
    measured.omega_2 = (y.r2.rate - y.v) * w2.per_radius;
    measured.F1 = y.r1.stretch > 0 && F1 > 0 ? F1 : 0;
    measured.F2 = y.r2.stretch > 0 && F2 > 0 ? F2 : 0;
    measured.bend = tanh(y.v * c.per_friction_velocity);
    double tau_1, tau_2;
    control(n, &measured, &reference[n], &g, &w1, &w2, &s, &m, &tau_1, &tau_2);
    y.r1.drive = d1.motor * tau_1;
    y.r2.drive = d2.motor * tau_2;
    if (!single(&y, &c, &d1, &d2, t, h)) careful(&y, &c, &d1, &d2, t, h / substeps, substeps);
    if (positions) positions[n] = y.x;
  }
  start->x = y.x;
  start->v = y.v;
  start->theta_1 = (y.r1.stretch + y.x) / c.radius_1;
  start->omega_1 = (y.r1.rate + y.v) / c.radius_1;
  start->theta_2 = (y.r2.stretch - y.x) / c.radius_2;
  start->omega_2 = (y.r2.rate - y.v) / c.radius_2;
  *sums = m;
}
