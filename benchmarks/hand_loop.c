/* One rollout of the paper's Case 4 with RK4 in equal sub-steps, written by hand: the limit the generated code of the
   same method is measured against. dualwinch computes what Case 4 leaves switched off as well, because a parameter's
   value must not need a compiler. */

#include "hand_case.h"

static inline void tensions(const struct motion *y, const struct plant *c, double *F1, double *F2) {
  double stretch_1 = c->radius_1 * y->theta_1 - y->x;
  double stretch_2 = c->radius_2 * y->theta_2 + y->x;
  double length_1 = larger(c->longest_1 - y->x, SHORTEST);
  double length_2 = larger(y->x + c->rope_offset, SHORTEST);
  double pull_1 = c->stiffness_1 / length_1 * stretch_1 + c->damping_1 * (c->radius_1 * y->omega_1 - y->v);
  double pull_2 = c->stiffness_2 / length_2 * stretch_2 + c->damping_2 * (c->radius_2 * y->omega_2 + y->v);
  *F1 = stretch_1 > 0 && pull_1 > 0 ? pull_1 : 0;
  *F2 = stretch_2 > 0 && pull_2 > 0 ? pull_2 : 0;
}

static inline struct motion derivative(double t, const struct motion *y, double tau_1, double tau_2,
                                       const struct plant *c) {
  double F1, F2;
  tensions(y, c, &F1, &F2);
  double v = y->v;
  double friction = c->friction * tanh(v * c->per_friction_velocity);
  double drag = c->drag * v * fabs(v);
  double vortex = c->vortex * drag * sin(c->shedding * v * t);
  struct motion dy;
  dy.x = v;
  dy.v = (F1 - F2 - friction - drag + vortex) * c->per_mass;
  dy.theta_1 = y->omega_1;
  dy.omega_1 = c->drive_1 * tau_1 - c->load_1 * F1;
  dy.theta_2 = y->omega_2;
  dy.omega_2 = c->drive_2 * tau_2 - c->load_2 * F2;
  return dy;
}

static inline struct motion along(const struct motion *y, const struct motion *slope, double h) {
  struct motion next;
  next.x = y->x + h * slope->x;
  next.v = y->v + h * slope->v;
  next.theta_1 = y->theta_1 + h * slope->theta_1;
  next.omega_1 = y->omega_1 + h * slope->omega_1;
  next.theta_2 = y->theta_2 + h * slope->theta_2;
  next.omega_2 = y->omega_2 + h * slope->omega_2;
  return next;
}

static inline struct motion rk4(double t, struct motion y, double tau_1, double tau_2, double h,
                                const struct plant *c) {
  struct motion k1 = derivative(t, &y, tau_1, tau_2, c);
  struct motion y2 = along(&y, &k1, h / 2);
  struct motion k2 = derivative(t + h / 2, &y2, tau_1, tau_2, c);
  struct motion y3 = along(&y, &k2, h / 2);
  struct motion k3 = derivative(t + h / 2, &y3, tau_1, tau_2, c);
  struct motion y4 = along(&y, &k3, h);
  struct motion k4 = derivative(t + h, &y4, tau_1, tau_2, c);
  struct motion mean;
  mean.x = k1.x + 2 * (k2.x + k3.x) + k4.x;
  mean.v = k1.v + 2 * (k2.v + k3.v) + k4.v;
  mean.theta_1 = k1.theta_1 + 2 * (k2.theta_1 + k3.theta_1) + k4.theta_1;
  mean.omega_1 = k1.omega_1 + 2 * (k2.omega_1 + k3.omega_1) + k4.omega_1;
  mean.theta_2 = k1.theta_2 + 2 * (k2.theta_2 + k3.theta_2) + k4.theta_2;
  mean.omega_2 = k1.omega_2 + 2 * (k2.omega_2 + k3.omega_2) + k4.omega_2;
  return along(&y, &mean, h / 6);
}

/* Runs `samples` samples from `start`; `positions` (one after each sample) may be null. */
void hand_loop(const struct parameters *p, const struct sample *reference, long samples, long substeps,
               struct motion *start, struct sums *sums, double *positions) {
  const struct plant c = prepare(p);
  const struct law g = prepare_law(p);
  const struct winch w1 = prepare_winch(p->drum_radius_1, p->gear_ratio_1, p->inertia_1, p->kp_1, p->ki_1, p);
  const struct winch w2 = prepare_winch(p->drum_radius_2, p->gear_ratio_2, p->inertia_2, p->kp_2, p->ki_2, p);
  const double h = p->sample_time / substeps;
  struct motion y = *start;
  struct controller s = {0};
  struct sums m = {0};
  m.least = 1e300;
  for (long n = 0; n < samples; ++n) {
    const double t = n * p->sample_time;
    struct measurement measured = {y.x, y.v, y.omega_1, y.omega_2, 0, 0, tanh(y.v * c.per_friction_velocity)};
    double tau_1, tau_2;
    tensions(&y, &c, &measured.F1, &measured.F2);
    control(n, &measured, &reference[n], &g, &w1, &w2, &s, &m, &tau_1, &tau_2);
    for (long i = 0; i < substeps; ++i) y = rk4(t + i * h, y, tau_1, tau_2, h, &c);
    if (positions) positions[n] = y.x;
  }
  *start = y;
  *sums = m;
}
