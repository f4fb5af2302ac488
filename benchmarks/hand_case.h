/* What both hand-written C loops share: Case 4's plant and controller (FANDO-NFTSM) as a control engineer would write
   them by hand, plain scalar C with constants worked out before the loop and libm's tanh, sin, exp and log. What Case 4
   leaves switched off (sensor errors, current, winch friction, speed filter, derivative gains, delay) is not in here. */

#include <math.h>

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
  double sum_abs, max_abs, sum_square;
  double steady_samples, steady_sum_abs, steady_max_abs, steady_sum_square;
  double saturated, torque_saturated, slack, peak, least, sum_change, F1_previous, F2_previous, work;
  double sum_torque_rate, sum_torque_square, tau_1_previous, tau_2_previous;
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

static inline double smaller(double a, double b) { return a < b ? a : b; }

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

/* Triangular labels with product inference are a bilinear interpolation in the rule table, which treats negative like
   positive: three labels of each magnitude remain. */
static inline double fuzzy(double error, double rate) {
  double a = 2 * smaller(fabs(error), 1), b = 2 * smaller(fabs(rate), 1);
  double zero = larger(1 - b, 0), big = larger(b - 1, 0), small = 1 - zero - big;
  double least = 0.25 * small + 0.5 * big, middle = 0.5 * zero + 0.5 * small + 0.75 * big, most = 1;
  double none = larger(1 - a, 0), full = larger(a - 1, 0);
  return none * least + (1 - none - full) * middle + full * most;
}

/* For a positive base: cheaper than pow, which gets the last bit right too. */
static inline double power(double base, double exponent) { return exp(exponent * log(base)); }

/* The controller's constants. */
struct law {
  double sample_time, per_sample_time, mass, per_mass, friction, drag;
  double per_beta, terminal, terminal_power, surface_power, smooth, eta, k, per_phi;
  double l0, kf, share, per_error_scale, per_rate_scale;
  double gamma, gamma_force, k_a, limit, preload, tension_min, tension_max;
};

struct winch {
  double to_torque, swing, kp, ki, least, most, gear, per_radius;
};

static struct law prepare_law(const struct parameters *p) {
  const double ratio = p->p / p->q;
  struct law g;
  g.sample_time = p->sample_time;
  g.per_sample_time = 1 / p->sample_time;
  g.mass = p->nominal_mass + p->nominal_added_mass;
  g.per_mass = 1 / g.mass;
  g.friction = p->nominal_friction_coefficient * p->normal_force;
  g.drag = 0.5 * p->nominal_drag_coefficient * p->water_density * p->drag_area;
  g.per_beta = 1 / p->beta;
  g.terminal = p->beta / ratio;
  g.terminal_power = (1 - ratio) / 2;
  g.surface_power = (ratio - 1) / 2;
  g.smooth = p->smoothing * p->smoothing;
  g.eta = p->eta;
  g.k = p->k;
  g.per_phi = 1 / p->phi;
  g.l0 = p->l0;
  g.kf = p->kf;
  g.share = p->sample_time / (p->filter_time + p->sample_time);
  g.per_error_scale = 1 / p->error_scale;
  g.per_rate_scale = 1 / (p->rate_scale * p->sample_time);
  g.gamma = p->gamma;
  g.gamma_force = p->gamma_force;
  g.k_a = p->k_a;
  g.limit = p->tension_max - p->tension_min;
  g.preload = p->preload;
  g.tension_min = p->tension_min;
  g.tension_max = p->tension_max;
  return g;
}

static struct winch prepare_winch(double radius, double gear, double inertia, double kp, double ki,
                                  const struct parameters *p) {
  struct winch w;
  w.to_torque = radius / gear;
  w.swing = inertia / gear;
  w.kp = kp;
  w.ki = ki;
  w.least = w.to_torque * p->tension_min;
  w.most = w.to_torque * p->tension_max;
  w.gear = gear;
  w.per_radius = 1 / radius;
  return w;
}

static inline double winch_torque(double command, double tension, double alpha, double sample_time,
                                  const struct winch *w, double *integral, double *limited) {
  double error = command - tension;
  double next = *integral + sample_time * error;
  double wanted = w->to_torque * command + w->swing * alpha + w->kp * error + w->ki * next;
  double torque = clip(wanted, w->least, w->most);
  if (torque == wanted) *integral = next;
  else *limited = 1;
  return torque;
}

/* What is measured of the plant at a sample, for controller and figures of merit; bend is tanh(v/friction velocity). */
struct measurement {
  double x, v, omega_1, omega_2, F1, F2, bend;
};

/* One sample of the controller and of the figures of merit. */
static inline void control(long n, const struct measurement *y, const struct sample *r, const struct law *g,
                           const struct winch *w1, const struct winch *w2, struct controller *s, struct sums *m,
                           double *tau_1, double *tau_2) {
  const double Ts = g->sample_time, v = y->v, F1 = y->F1, F2 = y->F2;

  /* observer */
  double e1 = y->x - r->x, e2 = v - r->v;
  double d_tilde = n > 0 ? (e2 - s->e2_previous) * g->per_sample_time - s->a_previous - s->d_hat : 0;
  double change = g->share * (d_tilde - s->filtered);
  s->filtered += change;
  double L1 = g->l0 + g->kf * fuzzy(s->filtered * g->per_error_scale, change * g->per_rate_scale);
  s->d_hat += (1 - exp(-L1 * Ts)) * d_tilde;

  /* position law */
  double resistance = g->friction * y->bend + g->drag * v * fabs(v);
  double z = e2 + g->gamma * s->Z_a;
  double surface = e1 + z * power(z * z + g->smooth, g->surface_power) * g->per_beta;
  double terminal = g->terminal * e2 * power(e2 * e2 + g->smooth, g->terminal_power);
  double reaching = g->eta * surface + g->k * clip(surface * g->per_phi, -1, 1);
  double u = g->mass * (r->a - terminal - reaching - s->d_hat) + resistance - g->gamma_force * s->Z_a;
  double u_sat = clip(u, -g->limit, g->limit);
  s->Z_a += Ts * (-g->k_a * s->Z_a + (u - u_sat));
  s->a_previous = (u_sat - resistance) * g->per_mass - r->a;
  s->e2_previous = e2;

  /* coordination and winches */
  double wanted_1 = (g->preload + u_sat) / 2, wanted_2 = (g->preload - u_sat) / 2;
  double excess_1 = clip(wanted_1, g->tension_min, g->tension_max) - wanted_1;
  double excess_2 = clip(wanted_2, g->tension_min, g->tension_max) - wanted_2;
  double command_1 = clip(wanted_1 + excess_2, g->tension_min, g->tension_max);
  double command_2 = clip(wanted_2 + excess_1, g->tension_min, g->tension_max);
  double limited = 0;
  *tau_1 = winch_torque(command_1, F1, r->a * w1->per_radius, Ts, w1, &s->integral_1, &limited);
  *tau_2 = winch_torque(command_2, F2, -r->a * w2->per_radius, Ts, w2, &s->integral_2, &limited);

  /* figures of merit */
  double size = fabs(e1), square = e1 * e1;
  m->sum_abs += size;
  m->max_abs = larger(m->max_abs, size);
  m->sum_square += square;
  m->steady_samples += r->steady;
  m->steady_sum_abs += r->steady * size;
  m->steady_max_abs = larger(m->steady_max_abs, r->steady * size);
  m->steady_sum_square += r->steady * square;
  m->saturated += u_sat != u;
  m->torque_saturated += limited;
  m->slack += F1 <= 0 || F2 <= 0;
  m->peak = larger(m->peak, larger(F1, F2));
  m->least = -larger(-m->least, larger(-F1, -F2));
  if (n > 0) m->sum_change += fabs(F1 - m->F1_previous) + fabs(F2 - m->F2_previous);
  m->F1_previous = F1;
  m->F2_previous = F2;
  m->work += Ts * (fabs(w1->gear * *tau_1 * y->omega_1) + fabs(w2->gear * *tau_2 * y->omega_2));
  if (n > 0) m->sum_torque_rate += (fabs(*tau_1 - m->tau_1_previous) + fabs(*tau_2 - m->tau_2_previous)) * g->per_sample_time;
  m->sum_torque_square += *tau_1 * *tau_1 + *tau_2 * *tau_2;
  m->tau_1_previous = *tau_1;
  m->tau_2_previous = *tau_2;
}
