/* A machine of the rig, or of the sea, around an exported controller: the plant of plant.h, sensors and random numbers of
   its own, written by hand from the specification. It shares nothing with the product but the controller's package;
   sensed.h, which says what the controller takes and sets its parameters, is written beside it.

   Arguments: first seed, number of runs, and the conditions of `read_conditions`; then any number of name=value, of
   effects.h, of the controller's parameters, or of `struct extent`. A line for each run: samples, samples whose readings
   the controller refused, mean square error (m^2), largest error (m), largest tension (N), smallest (N), chatter (N),
   samples with a slack rope, largest net force that the reference asks for (N), smallest torque between the gearboxes'
   teeth, at the drum (N m; 0 without). With log=N also, on stderr, what was drawn of mass, drag, friction and moduli, and
   of every N samples what a data logger records: t, x, v, F1, F2, theta_1, theta_2 and the commands tau_1, tau_2. */

#include <stdint.h>
#include <stdio.h>

#include "plant.h"
#include "sensed.h"

#define LONGEST_DELAY 8
#define LONGEST_LATE 128

static const double DRUM_FRICTION = 96.0;

/* ---- random numbers: SplitMix64, Box-Muller ---- */

static uint64_t random_state;

static uint64_t bits(void) {
  uint64_t z = random_state += 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

static double uniform(double low, double high) { return low + (high - low) * ((double)(bits() >> 11) * 0x1p-53); }

static double normal(void) {
  double size = sqrt(-2.0 * log(1.0 - uniform(0.0, 1.0)));
  return size * cos(2.0 * PI * uniform(0.0, 1.0));
}

/* Of a stream of its own, so that what it is for changes nothing else. */
static double normal_aside(uint64_t *stream) {
  uint64_t kept = random_state;
  double value;
  random_state = *stream, value = normal(), *stream = random_state, random_state = kept;
  return value;
}

/* First-order Gauss-Markov, from sample to sample. */
static double go_on(double value, double sigma, double decay) {
  return decay * value + sqrt(1.0 - decay * decay) * sigma * normal();
}

/* ---- what is drawn ---- */

struct conditions {
  double preload, spread, imperfect; /* N; size of what the sea varies, and of imperfections, over that of the rig */
  int noisy, delay, missing;
  double outage_length, outage_period; /* s; 0: none */
};

static double around(double size, double low, double high) {
  double middle = (low + high) / 2;
  return middle + size * (uniform(low, high) - middle);
}

static struct machine drawn(const struct conditions *how, const struct effects *effects) {
  double size = how->spread, off = how->imperfect, lag;
  struct machine m;
  m.is = *effects;
  m.plain = plain(effects);
  m.mass = 1e4 * around(size, 0.9, 1.1);
  m.drag = 0.3 * around(size, 0.8, 1.2);
  m.friction = 0.1 * around(size, 0.5, 1.5);
  m.strouhal = around(size, 0.18, 0.22);
  for (int i = 0; i < 2; i++) {
    struct winch *w = &m.winch[i];
    w->modulus = 80e9 * around(size, 0.9, 1.1);
    w->damping = 1000.0 * around(size, 0.7, 1.3);
    w->inertia = 1.8 * around(size, 0.9, 1.1);
    w->radius_error = off * uniform(-2e-3, 2e-3);
    w->eccentricity = off * uniform(0.0, 1e-4);
    w->run_out_angle = uniform(-PI, PI);
    w->layer = off * uniform(0.0, 2e-4);
    w->creep = off * uniform(0.0, 5e-4);
    w->torque_error = off * uniform(-0.02, 0.02);
    w->ripple = off * uniform(0.0, 0.01);
    w->ripple_angle = uniform(-PI, PI);
    w->encoder_zero = off * uniform(-1e-3, 1e-3);
    w->cell_error = off * uniform(-0.01, 0.01);
    w->cell_zero = off * uniform(-30.0, 30.0);
  }
  lag = exp(uniform(log(2e-4), log(8e-3)));
  m.motor_lag = off * lag;
  m.bias = off * uniform(-2e-3, 2e-3);
  m.drift = off * 1e-4;
  m.jitter = off * 50e-6;
  m.position_noise = how->noisy * 0.5e-3;
  m.resolution = how->noisy * 1e-3;
  m.speed_noise = how->noisy * 2e-3;
  m.tension_noise = how->noisy * 10.0;
  m.counts = how->noisy * 4096.0;
  m.current_sigma = how->noisy * 0.05;
  m.load_sigma = how->noisy * 0.1 * RAIL_LOAD;
  m.coulomb = DRUM_FRICTION;
  return m;
}

/* ---- reference, sensors, and the run ---- */

static void reference(double t, double *wanted) {
  if (t <= 18.0) {
    wanted[0] = 0.05 * t * t, wanted[1] = 0.1 * t, wanted[2] = 0.1;
  } else if (t <= 29.0) {
    wanted[0] = 1.8 * t - 16.2, wanted[1] = 1.8, wanted[2] = 0.0;
  } else if (t <= 41.0) {
    wanted[0] = -0.075 * t * t + 6.15 * t - 79.275, wanted[1] = -0.15 * t + 6.15, wanted[2] = -0.15;
  } else {
    wanted[0] = 46.8, wanted[1] = 0.0, wanted[2] = 0.0;
  }
}

static double rounded(double value, double step) { return step > 0.0 ? step * floor(value / step + 0.5) : value; }

/* Where in the faults a time is: whether one is on, and how many have been, the present one in part. */
static void faults(const struct effects *is, double t, double *on, double *count) {
  double since = t - is->fault_start, past = fmax(floor(since / is->fault_period), 0.0);
  double share = (since - past * is->fault_period) / is->fault_length;
  *on = share >= 0.0 && share < 1.0 ? 1.0 : 0.0;
  *count = past + fmin(fmax(share, 0.0), 1.0);
}

/* Whether a sensor reads in a sample, of which it has a share of readings; 0: it always does. */
static int is_due(long number, double share) {
  return share <= 0.0 || floor((double)number * share + 1e-6) > floor((double)(number - 1) * share + 1e-6);
}

/* Positions at the last samples, the latest first, with their times. */
struct track {
  double t[LONGEST_LATE], x[LONGEST_LATE];
};

/* The position a time ago, on straight lines between samples. */
static double earlier(struct track *track, double t, double x, double late) {
  memmove(track->t + 1, track->t, (LONGEST_LATE - 1) * sizeof *track->t);
  memmove(track->x + 1, track->x, (LONGEST_LATE - 1) * sizeof *track->x);
  track->t[0] = t, track->x[0] = x;
  if (late <= 0.0) return x;
  for (int n = 1; n < LONGEST_LATE; n++) {
    double share = (t - late - track->t[n]) / (track->t[n - 1] - track->t[n]);
    if (share >= 0.0) return track->x[n] + share * (track->x[n - 1] - track->x[n]);
  }
  return track->x[LONGEST_LATE - 1];
}

static double needed(const struct machine *m, const double *wanted, const struct held *held) {
  double v = wanted[1], through = v - held->current;
  return m->mass * wanted[2] + m->friction * (RAIL_LOAD + held->load) +
         HALF_WATER * m->drag * (through * fabs(through) + VORTICES * v * v);
}

/* Of a run: a line for every so many samples (0: none), of a trace or of what a data logger records, and the error in m
   at which it is lost and ends. */
struct extent {
  long trace, log;
  double give_up;
};

/* What an estimator would take off an encoder's angle at a measured tension, for the share that it has learnt. */
static double learnt(const struct machine *m, int i, double x, double tension) {
  const struct effects *is = &m->is;
  double length = fmax(free_length(i, x), SHORTEST), pull = fmax(tension, 100.0), angle = 0.0;
  double modulus = m->winch[i].modulus * is->modulus_factor[i];
  if (gives(m, i)) angle += is->learnt_gear * tension * DRUM / is->gear_stiffness[i];
  if (is->learnt_sag > 0.0 && is->submerged_weight[i] > 0.0) {
    struct spans s = spans_of(m, length);
    angle -= is->learnt_sag * shortening(&s, is->submerged_weight[i] * s.span * s.span / (8.0 * pull)) / DRUM;
  }
  angle += is->learnt_modulus * tension * length / AREA * (1.0 / modulus - 1.0 / 80e9) / DRUM;
  return angle;
}

/* Speed of a motor's shaft, as at the drum, as its drive measures it. */
static double shaft_speed(const struct machine *m, const double *state, int i, uint64_t *noise) {
  double speed = state[(gives(m, i) ? SPIN : OMEGA) + i];
  return m->is.speed_noise > 0.0 ? speed + m->is.speed_noise * normal_aside(noise) : speed;
}

/* Damping of drum speeds, within the torques that the controller's limits allow. */
static void damp(const struct machine *m, const dualwinch_controller_parameters *parameters, const double *omega,
                 const double *wanted, double sample, double *speed, double *torque) {
  const struct effects *is = &m->is;
  double lever = DRUM / RATIO, least = lever * (double)parameters->controller_coordination_tension_min;
  double most = lever * (double)parameters->controller_coordination_tension_max;
  for (int i = 0; i < 2; i++) {
    speed[i] += sample / (is->speed_lag + sample) * (omega[i] - speed[i]);
    torque[i] -= is->speed_damping * (speed[i] - direction(i) * wanted[1] / DRUM);
    torque[i] = fmax(least, fmin(most, torque[i]));
  }
}

/* ---- overloads ---- */

static int within(double t, double start, double length) { return t >= start && t < start + length; }

/* Torque that a drive lets its motor have, of the one that arrives: none while it is off, else as much as power and heat
   allow. Heat is the integral of the squared torque beyond the rated one; at its limit the rated torque is the most. */
static double driven(const struct machine *m, int i, double t, double sample, double speed, double torque, double *heat,
                     int *hot) {
  const struct effects *is = &m->is;
  double most = is->most_torque[i], rated = is->rated_torque[i];
  if (within(t, is->dropout_start[i], is->dropout_length[i])) return 0.0;
  if (most <= 0.0) return torque;
  if (rated > 0.0) {
    double full = is->overload_time * (most * most - rated * rated), now = fmin(fabs(torque), *hot ? rated : most);
    *heat = fmax(*heat + sample * (now * now - rated * rated), 0.0);
    *hot = *heat >= full || (*hot && *heat > full / 2.0);
    if (*hot) most = rated;
  }
  if (is->base_speed > 0.0) most *= fmin(1.0, is->base_speed / fmax(fabs(speed), 1e-9));
  return fmax(-most, fmin(most, torque));
}

static void run(uint64_t seed, const struct conditions *how, const struct effects *effects,
                const dualwinch_controller_parameters *given, const struct extent *extent) {
  dualwinch_controller_state memory;
  dualwinch_controller_parameters parameters = *given;
  dualwinch_controller_prepared prepared;
  dualwinch_controller_input input;
  dualwinch_controller_output output;
  struct machine m;
  struct held held = {{0.0, 0.0}, 0.0, 0.0, 0.0};
  struct sensed sensed;
  struct forces forces;
  struct track track;
  double state[STATES], queue[LONGEST_DELAY + 1][2], before[2] = {0.0, 0.0}, wanted[3];
  double square = 0.0, furthest = 0.0, largest = 0.0, smallest = INFINITY, change = 0.0, most = 0.0;
  double sample, current, load, drift = 0.0, late = 0.0, shown = 0.0, least_gear = INFINITY, speed[2] = {0.0, 0.0};
  double resting = DRUM / RATIO * how->preload / 2.0, equal[2] = {how->preload / 2.0, how->preload / 2.0};
  double resting_torques[2] = {resting, resting};
  uint64_t speed_stream = seed * 104729u + 7u;
  long refused = dualwinch_controller_prepare(&parameters, &prepared) != 0, slack = 0, samples, k;
  long silent_from = 0, silent_to = 0, period, loaded = 0;
  double heat[2] = {0.0, 0.0};
  int hot[2] = {0, 0};

  refused += dualwinch_controller_reset(&memory, &prepared) != 0;
  random_state = seed * 7919u + 13u;
  m = drawn(how, effects);
  sample = (double)parameters.simulation_sample_time;
  samples = lround(50.0 / sample);
  period = lround(how->outage_period / sample);
  rest(&m, -m.bias, equal, resting_torques, state);
  for (int n = 0; n <= LONGEST_DELAY; n++) queue[n][0] = queue[n][1] = resting;
  current = m.current_sigma * normal(), load = m.load_sigma * normal();

  if (extent->log)
    fprintf(stderr, "%.17g,%.17g,%.17g,%.17g,%.17g\n", m.mass, m.drag, m.friction, m.winch[0].modulus, m.winch[1].modulus);

  for (int n = 0; n < LONGEST_LATE; n++) track.t[n] = -(n + 1.0) * sample, track.x[n] = state[X];
  for (k = 0; k < samples; k++) {
    double t = (double)k * sample + late, off = m.bias + m.drift * drift, next_late, tension[2], error;
    double slipping, slips, warm = 1.0 - exp(-t / m.is.drift_time);
    pull(&m, t, state, &forces);
    faults(&m.is, t, &slipping, &slips);
    reference((double)k * sample, wanted);
    if (period > 0 && k % period == 0) {
      long length = lround(how->outage_length / sample * uniform(0.5, 1.5));
      silent_from = k + (long)uniform(0.0, (double)(period - length)), silent_to = silent_from + length;
    }
    off += slipping * m.is.position_fault;
    sensed.x = rounded(earlier(&track, t, state[X], m.is.position_late) + off + m.position_noise * normal(), m.resolution);
    if (k > 0 && !is_due(k, sample * m.is.position_rate)) sensed.x = shown;
    if (k >= silent_from && k < silent_to) sensed.x = how->missing ? NAN : shown;
    if (isfinite(sensed.x)) shown = sensed.x;
    sensed.v = state[V] * (1.0 + m.is.wheel_error * (1.0 - m.is.learnt_wheel)) * (1.0 + slipping * m.is.wheel_slip);
    sensed.v += m.speed_noise * normal();
    for (int i = 0; i < 2; i++) {
      const struct winch *w = &m.winch[i];
      double count = m.counts > 0.0 ? 2.0 * PI / (RATIO * m.counts) : 0.0;
      double cell = m.is.cell_bandwidth > 0.0 ? state[CELL + i] : cell_tension(&m, &forces, i);
      sensed.F[i] = cell * (1.0 + w->cell_error) + w->cell_zero + warm * m.is.cell_drift[i] + m.tension_noise * normal();
      sensed.omega[i] = shaft_speed(&m, state, i, &speed_stream);
      double zero = (w->encoder_zero - slips * m.is.encoder_slip[i]) / DRUM;
      sensed.theta[i] = rounded(state[(gives(&m, i) ? TURN : THETA) + i] + zero, count);
      sensed.theta[i] -= learnt(&m, i, state[X], sensed.F[i]);
    }
    memcpy(sensed.reference, wanted, sizeof wanted);
    give(&input, &sensed);
    refused += dualwinch_controller_step(&memory, &input, &prepared, &output) != 0;

    error = state[X] + m.bias - wanted[0] - late * (wanted[1] + late * wanted[2] / 2.0);
    square += error * error;
    furthest = fmax(furthest, fabs(error));
    for (int i = 0; i < 2; i++) {
      double lowest = INFINITY;
      tension[i] = cell_tension(&m, &forces, i);
      for (int j = 0; j < segments(&m, i); j++) {
        largest = fmax(largest, forces.rope[i][j].tension), lowest = fmin(lowest, forces.rope[i][j].tension);
      }
      smallest = fmin(smallest, lowest);
      slack += lowest <= m.is.slack_below;
      if (gives(&m, i)) least_gear = fmin(least_gear, forces.gear[i].tension);
      change += k ? fabs(tension[i] - before[i]) : 0.0;
      before[i] = tension[i];
    }

    held.asked[0] = (double)output.tau_1, held.asked[1] = (double)output.tau_2;
    if (m.is.speed_damping > 0.0) damp(&m, &parameters, sensed.omega, wanted, sample, speed, held.asked);
    if (extent->trace && k % extent->trace == 0)
      fprintf(stderr, "%.4f %.7g %.7g %.7g %.7g %.7g %.7g %.7g %.7g\n", t, error, state[V] - wanted[1], tension[0],
              tension[1], held.asked[0], held.asked[1], (double)output.u_sat, sensed.x - state[X]);
    for (int i = 0; i < 2; i++) held.asked[i] = rounded(held.asked[i], m.is.torque_step);
    if (extent->log && k % extent->log == 0)
      fprintf(stderr, "%.4f,%.6f,%.6f,%.3f,%.3f,%.9f,%.9f,%.6f,%.6f\n", (double)k * sample, sensed.x, sensed.v,
              sensed.F[0], sensed.F[1], sensed.theta[0], sensed.theta[1], held.asked[0], held.asked[1]);
    memmove(queue[1], queue[0], LONGEST_DELAY * sizeof queue[0]);
    memcpy(queue[0], held.asked, sizeof held.asked);
    memcpy(held.asked, queue[how->delay], sizeof held.asked);
    if (!loaded && t >= m.is.payload_start) {
      m.mass *= 1.0 + m.is.payload_mass, m.drag *= 1.0 + m.is.payload_drag, loaded = 1;
    }
    held.push = within(t, m.is.push_start, m.is.push_length) ? m.is.push_force : 0.0;
    for (int i = 0; i < 2; i++) {
      double shaft = RATIO * state[(gives(&m, i) ? SPIN : OMEGA) + i];
      held.asked[i] = driven(&m, i, t, sample, shaft, held.asked[i], &heat[i], &hot[i]);
    }
    held.current = fmax(-0.154, fmin(0.154, current)), held.load = load;
    most = fmax(most, needed(&m, wanted, &held));
    next_late = m.jitter * uniform(-1.0, 1.0);
    move(&m, t, sample + next_late - late, state, &held);
    late = next_late;
    current = go_on(current, m.current_sigma, exp(-sample / 20.0));
    load = go_on(load, m.load_sigma, exp(-sample / 5.0));
    drift = go_on(drift, 1.0, exp(-sample / 3600.0));
    if (!(state[X] >= -OVERRUN && state[X] <= TRACK + OVERRUN && fabs(error) < extent->give_up)) {
      k++;
      break;
    }
  }
  printf("%ld %ld %.9g %.9g %.9g %.9g %.9g %ld %.9g %.9g\n", k, refused, square / (double)k, furthest, largest, smallest,
         change / (2.0 * (double)(k - 1)), slack, most, isfinite(least_gear) ? least_gear : 0.0);
  fflush(stdout);
}

static struct conditions read_conditions(char **texts) {
  struct conditions how;
  how.preload = atof(texts[0]), how.spread = atof(texts[1]), how.imperfect = atof(texts[2]);
  how.noisy = atoi(texts[3]), how.delay = atoi(texts[4]), how.missing = atoi(texts[5]);
  how.outage_length = atof(texts[6]), how.outage_period = atof(texts[7]);
  return how;
}

/* What a text name=value sets: 0 where nothing has that name. */
static int set(const char *text, struct effects *effects, dualwinch_controller_parameters *parameters,
               struct extent *extent) {
  const char *sign = strchr(text, '=');
  size_t length = sign ? (size_t)(sign - text) : 0;
  double value = sign ? atof(sign + 1) : 0.0;
  if (!sign) return 0;
  if (strncmp(text, "trace=", 6) == 0) return extent->trace = lround(value), 1;
  if (strncmp(text, "log=", 4) == 0) return extent->log = lround(value), 1;
  if (strncmp(text, "give_up=", 8) == 0) return extent->give_up = value, 1;
  return set_effect(effects, text, length, value) || set_parameter(parameters, text, length, value);
}

int main(int count, char **texts) {
  struct conditions how;
  struct effects effects = NO_EFFECTS;
  struct extent extent = {0, 0, INFINITY};
  dualwinch_controller_parameters parameters;
  if (count < 11) return 2;
  how = read_conditions(texts + 3);
  if (how.delay < 0 || how.delay > LONGEST_DELAY) return 2;
  dualwinch_controller_defaults(&parameters);
  for (int n = 11; n < count; n++) {
    if (!set(texts[n], &effects, &parameters, &extent)) {
      fprintf(stderr, "%s: no such effect or parameter\n", texts[n]);
      return 2;
    }
  }
  if (!(effects.segments >= 1.0 && effects.segments <= LARGEST_SEGMENTS)) {
    fprintf(stderr, "segments: must be from 1 to %d\n", LARGEST_SEGMENTS);
    return 2;
  }
  for (int n = 0; n < atoi(texts[2]); n++)
    run(strtoull(texts[1], NULL, 10) + (uint64_t)n, &how, &effects, &parameters, &extent);
  return 0;
}
