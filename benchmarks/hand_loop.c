/* One rollout of the paper's Case 4 (FANDO-NFTSM, RK4 with equal sub-steps) as a control engineer would write it by
   hand: plain scalar C, constants worked out before the loop, libm's tanh, sin, pow and exp. It is the limit the
   generated code is measured against. What Case 4 leaves switched off (sensor errors, current, winch friction, speed
   filter, derivative gains, delay) is not in here. */

#include <math.h>
#include <string.h>

/* In the order of benchmarks.by_hand.parameters.Parameters. */
struct parameters {
  double sample_time;
  double mass, added_mass, drag_coefficient, drag_area, diameter, water_density;
  double normal_force, friction_coefficient, friction_velocity;
  double track_length, rope_offset;
  double area_1, modulus_1, damping_1, area_2, modulus_2, damping_2;
  double inertia_1, drum_radius_1, gear_ratio_1, inertia_2, drum_radius_2, gear_ratio_2;
  double vortex, vortex_amplitude, strouhal;
  double nominal_mass, nominal_added_mass, nominal_drag_coefficient, nominal_friction_coefficient;
  double beta, eta, k, phi, p, q, smoothing;
  double l0, kf, error_scale, rate_scale, filter_time;
  double gamma, gamma_force, k_a;
  double preload, tension_min, tension_max;
  double kp_1, ki_1, kp_2, ki_2;
};

/* In the order of simulation.metrics.Accumulators. */
struct sums {
  double samples, sum_abs, max_abs, sum_square;
  double steady_samples, steady_sum_abs, steady_max_abs, steady_sum_square;
  double saturated, torque_saturated, slack, peak, least, sum_change, F1_previous, F2_previous, work;
};

struct plant {
  double stiffness_1, stiffness_2, damping_1, damping_2, radius_1, radius_2;
  double longest_1, rope_offset;
  double friction, per_friction_velocity, drag, vortex, shedding, per_mass;
  double drive_1, load_1, drive_2, load_2;
};

struct motion {
  double x, v, theta_1, omega_1, theta_2, omega_2;
};

struct controller {
  double Z_a, d_hat, filtered, e2_previous, a_previous, integral_1, integral_2;
};

struct sample {
  double x, v, a, steady;
};

static const double SHORTEST = 0.05;

static inline double larger(double a, double b) { return a > b ? a : b; }

static inline double clip(double value, double lower, double upper) {
  return value < lower ? lower : value > upper ? upper : value;
}

static struct plant prepare(const struct parameters *p) {
  const double pi = 3.14159265358979323846;
  struct plant c;
  c.stiffness_1 = p->modulus_1 * p->area_1;
  c.stiffness_2 = p->modulus_2 * p->area_2;
  c.damping_1 = p->damping_1;
  c.damping_2 = p->damping_2;
  c.radius_1 = p->drum_radius_1;
  c.radius_2 = p->drum_radius_2;
  c.longest_1 = p->track_length + p->rope_offset;
  c.rope_offset = p->rope_offset;
  c.friction = p->friction_coefficient * p->normal_force;
  c.per_friction_velocity = 1 / p->friction_velocity;
  c.drag = 0.5 * p->drag_coefficient * p->water_density * p->drag_area;
  c.vortex = p->vortex * p->vortex_amplitude;
  c.shedding = 2 * pi * p->strouhal / p->diameter;
  c.per_mass = 1 / (p->mass + p->added_mass);
  c.drive_1 = p->gear_ratio_1 / p->inertia_1;
  c.load_1 = p->drum_radius_1 / p->inertia_1;
  c.drive_2 = p->gear_ratio_2 / p->inertia_2;
  c.load_2 = p->drum_radius_2 / p->inertia_2;
  return c;
}

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

/* Triangular labels at -1, -0.5, 0, 0.5, 1 with product inference are a bilinear interpolation in the rule table. */
static double fuzzy(double error, double rate) {
  static const double RULES[5][5] = {
      {1, 1, 1, 1, 1}, {.75, .5, .5, .5, .75}, {.5, .25, 0, .25, .5}, {.75, .5, .5, .5, .75}, {1, 1, 1, 1, 1}};
  double a = 2 * (clip(error, -1, 1) + 1), b = 2 * (clip(rate, -1, 1) + 1);
  int i = a < 3 ? (int)a : 3, j = b < 3 ? (int)b : 3;
  a -= i;
  b -= j;
  return (1 - a) * ((1 - b) * RULES[i][j] + b * RULES[i][j + 1]) +
         a * ((1 - b) * RULES[i + 1][j] + b * RULES[i + 1][j + 1]);
}

static inline double winch(double command, double tension, double alpha, double radius, double gear, double inertia,
                           double kp, double ki, double *integral, double *limited, const struct parameters *p) {
  double to_torque = radius / gear;
  double error = command - tension;
  double next = *integral + p->sample_time * error;
  double wanted = to_torque * command + inertia / gear * alpha + kp * error + ki * next;
  double torque = clip(wanted, to_torque * p->tension_min, to_torque * p->tension_max);
  if (torque == wanted) *integral = next;
  else *limited = 1;
  return torque;
}

/* Runs `samples` samples from `y`; `positions` (one after each sample) may be null. */
void hand_loop(const struct parameters *p, const struct sample *reference, long samples, long substeps,
               struct motion *start, struct sums *sums, double *positions) {
  const struct plant c = prepare(p);
  const double Ts = p->sample_time, h = Ts / substeps;
  const double M = p->nominal_mass + p->nominal_added_mass;
  const double nominal_friction = p->nominal_friction_coefficient * p->normal_force;
  const double nominal_drag = 0.5 * p->nominal_drag_coefficient * p->water_density * p->drag_area;
  const double ratio = p->p / p->q, smooth = p->smoothing * p->smoothing;
  const double share = Ts / (p->filter_time + Ts);
  const double limit = p->tension_max - p->tension_min;
  struct motion y = *start;
  struct controller s = {0};
  struct sums m;
  memset(&m, 0, sizeof m);
  m.least = 1e300;

  for (long n = 0; n < samples; ++n) {
    const double t = n * Ts;
    const struct sample *r = &reference[n];
    double F1, F2;
    tensions(&y, &c, &F1, &F2);

    /* observer */
    double e1 = y.x - r->x, e2 = y.v - r->v;
    double d_tilde = n > 0 ? (e2 - s.e2_previous) / Ts - s.a_previous - s.d_hat : 0;
    double change = share * (d_tilde - s.filtered);
    s.filtered += change;
    double L1 = p->l0 + p->kf * fuzzy(s.filtered / p->error_scale, change / Ts / p->rate_scale);
    s.d_hat += (1 - exp(-L1 * Ts)) * d_tilde;

    /* position law */
    double resistance = nominal_friction * tanh(y.v * c.per_friction_velocity) + nominal_drag * y.v * fabs(y.v);
    double z = e2 + p->gamma * s.Z_a;
    double surface = e1 + z * pow(z * z + smooth, (ratio - 1) / 2) / p->beta;
    double terminal = p->beta / ratio * e2 * pow(e2 * e2 + smooth, (1 - ratio) / 2);
    double reaching = p->eta * surface + p->k * clip(surface / p->phi, -1, 1);
    double u = M * (r->a - terminal - reaching - s.d_hat) + resistance - p->gamma_force * s.Z_a;
    double u_sat = clip(u, -limit, limit);
    s.Z_a += Ts * (-p->k_a * s.Z_a + (u - u_sat));
    s.a_previous = (u_sat - resistance) / M - r->a;
    s.e2_previous = e2;

    /* coordination and winches */
    double wanted_1 = (p->preload + u_sat) / 2, wanted_2 = (p->preload - u_sat) / 2;
    double excess_1 = clip(wanted_1, p->tension_min, p->tension_max) - wanted_1;
    double excess_2 = clip(wanted_2, p->tension_min, p->tension_max) - wanted_2;
    double command_1 = clip(wanted_1 + excess_2, p->tension_min, p->tension_max);
    double command_2 = clip(wanted_2 + excess_1, p->tension_min, p->tension_max);
    double limited = 0;
    double tau_1 = winch(command_1, F1, r->a / p->drum_radius_1, p->drum_radius_1, p->gear_ratio_1, p->inertia_1,
                         p->kp_1, p->ki_1, &s.integral_1, &limited, p);
    double tau_2 = winch(command_2, F2, -r->a / p->drum_radius_2, p->drum_radius_2, p->gear_ratio_2, p->inertia_2,
                         p->kp_2, p->ki_2, &s.integral_2, &limited, p);

    /* figures of merit */
    double size = fabs(e1), square = e1 * e1;
    m.samples += 1;
    m.sum_abs += size;
    m.max_abs = larger(m.max_abs, size);
    m.sum_square += square;
    m.steady_samples += r->steady;
    m.steady_sum_abs += r->steady * size;
    m.steady_max_abs = larger(m.steady_max_abs, r->steady * size);
    m.steady_sum_square += r->steady * square;
    m.saturated += u_sat != u;
    m.torque_saturated += limited;
    m.slack += F1 <= 0 || F2 <= 0;
    m.peak = larger(m.peak, larger(F1, F2));
    m.least = -larger(-m.least, larger(-F1, -F2));
    if (n > 0) m.sum_change += fabs(F1 - m.F1_previous) + fabs(F2 - m.F2_previous);
    m.F1_previous = F1;
    m.F2_previous = F2;
    m.work += Ts * (fabs(p->gear_ratio_1 * tau_1 * y.omega_1) + fabs(p->gear_ratio_2 * tau_2 * y.omega_2));

    for (long i = 0; i < substeps; ++i) y = rk4(t + i * h, y, tau_1, tau_2, h, &c);
    if (positions) positions[n] = y.x;
  }
  *start = y;
  *sums = m;
}
