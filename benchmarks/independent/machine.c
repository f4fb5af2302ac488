/* A machine of the rig, or of the sea, around an exported controller: vehicle, ropes, winches, motors and sensors, written
   by hand from the specification, with random numbers of its own. It shares nothing with the product but the controller's
   package; sensed.h, which says what the controller takes, is written beside it.

   Arguments: first seed, number of runs, and the conditions of `read_conditions`. A line for each run: samples, samples
   whose readings the controller refused, mean square error (m^2), largest error (m), largest tension (N), smallest (N),
   chatter (N), samples with a slack rope, largest net force that the reference asks for (N). */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sensed.h"

#define SUBSTEPS 64
#define LONGEST_DELAY 8

static const double PI = 3.14159265358979323846;
static const double DRUM = 0.8, RATIO = 36.0, AREA = 4.52e-4, TRACK = 50.0, OFFSET = 0.5, OVERRUN = 0.25;
static const double RAIL_LOAD = 4900.0, RAIL_SPEED = 0.01, HALF_WATER = 0.5 * 1000.0 * 6.0, HULL = 2.0, VORTICES = 0.2;
static const double DRUM_FRICTION = 96.0, DRUM_SPEED = 0.01, LAPS = 20.0, CREEPING = 60.0, WAVES = 6.0;

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

struct winch {
  double inertia, radius_error, eccentricity, run_out_angle, layer, torque_error, ripple, ripple_angle;
  double modulus, damping, creep, encoder_zero, cell_error, cell_zero;
};

struct machine {
  double mass, drag, friction, strouhal, motor_lag, bias, drift, jitter;
  double position_noise, resolution, speed_noise, tension_noise, counts, current_sigma, load_sigma, coulomb;
  struct winch winch[2];
};

static double around(double size, double low, double high) {
  double middle = (low + high) / 2;
  return middle + size * (uniform(low, high) - middle);
}

static struct machine drawn(const struct conditions *how) {
  double size = how->spread, off = how->imperfect, lag;
  struct machine m;
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

/* ---- the machine's motion: position, two drum angles, their speeds, two motor torques ---- */

enum { X, THETA, V = 3, OMEGA, TORQUE = 6, STATES = 8 };

struct held {
  double asked[2], current, load; /* N m, m/s, N */
};

static double direction(int i) { return i ? -1.0 : 1.0; }

static double free_length(int i, double x) { return (i ? x : TRACK - x) + OFFSET; }

static double radius(const struct winch *w, double theta) {
  return DRUM * (1.0 + w->radius_error) + w->layer / LAPS / (2.0 * PI) * theta +
         w->eccentricity * cos(theta + w->run_out_angle);
}

static double wound(const struct winch *w, double theta) {
  double run_out = w->eccentricity * (sin(theta + w->run_out_angle) - sin(w->run_out_angle));
  return DRUM * (1.0 + w->radius_error) * theta + w->layer / LAPS / (4.0 * PI) * theta * theta + run_out;
}

static double angle_of(const struct winch *w, double rope) {
  double theta = rope / DRUM;
  for (int k = 0; k < 50; k++) theta -= (wound(w, theta) - rope) / radius(w, theta);
  return theta;
}

static void pull(const struct machine *m, double t, const double *state, double *tension) {
  for (int i = 0; i < 2; i++) {
    const struct winch *w = &m->winch[i];
    double longer = w->creep * (1.0 - exp(-t / CREEPING)), lengthening = w->creep * exp(-t / CREEPING) / CREEPING;
    double stretch = wound(w, state[THETA + i]) - direction(i) * state[X] - longer;
    double rate = radius(w, state[THETA + i]) * state[OMEGA + i] - direction(i) * state[V] - lengthening;
    double force = w->modulus * AREA / free_length(i, state[X]) * stretch + w->damping * rate;
    tension[i] = stretch > 0.0 && force > 0.0 ? force : 0.0;
  }
}

static double resistance(const struct machine *m, double t, double v, const struct held *held) {
  double through = v - held->current, shedding = 2.0 * PI * m->strouhal / HULL * v * t;
  return m->friction * (RAIL_LOAD + held->load) * tanh(v / RAIL_SPEED) +
         HALF_WATER * m->drag * (through * fabs(through) - VORTICES * v * fabs(v) * sin(shedding));
}

static void slope(const struct machine *m, double t, const double *state, const struct held *held, double *rate) {
  double tension[2], v = state[V];
  pull(m, t, state, tension);
  rate[X] = v;
  rate[V] = (tension[0] - tension[1] - resistance(m, t, v, held)) / m->mass;
  for (int i = 0; i < 2; i++) {
    const struct winch *w = &m->winch[i];
    double theta = state[THETA + i], omega = state[OMEGA + i];
    double wave = w->ripple * sin(w->ripple_angle + WAVES * RATIO * theta);
    double torque = (m->motor_lag > 0.0 ? state[TORQUE + i] : held->asked[i]) * (1.0 + w->torque_error + wave);
    double opposing = radius(w, theta) * tension[i] + m->coulomb * tanh(omega / DRUM_SPEED);
    rate[THETA + i] = omega;
    rate[OMEGA + i] = (RATIO * torque - opposing) / w->inertia;
    rate[TORQUE + i] = m->motor_lag > 0.0 ? (held->asked[i] - state[TORQUE + i]) / m->motor_lag : 0.0;
  }
}

/* Classical Runge-Kutta steps. */
static void move(const struct machine *m, double t, double duration, double *state, const struct held *held) {
  static const double reach[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
  double h = duration / SUBSTEPS;
  for (int step = 0; step < SUBSTEPS; step++) {
    double rate[STATES] = {0.0}, at[STATES], change[STATES] = {0.0};
    for (int stage = 0; stage < 4; stage++) {
      for (int k = 0; k < STATES; k++) at[k] = state[k] + reach[stage] * h * rate[k];
      slope(m, t + (step + reach[stage]) * h, at, held, rate);
      for (int k = 0; k < STATES; k++) change[k] += weight[stage] * h * rate[k];
    }
    for (int k = 0; k < STATES; k++) state[k] += change[k];
  }
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

static double needed(const struct machine *m, const double *wanted, const struct held *held) {
  double v = wanted[1], through = v - held->current;
  return m->mass * wanted[2] + m->friction * (RAIL_LOAD + held->load) +
         HALF_WATER * m->drag * (through * fabs(through) + VORTICES * v * v);
}

static void run(uint64_t seed, const struct conditions *how) {
  dualwinch_controller_state memory;
  dualwinch_controller_parameters parameters;
  dualwinch_controller_prepared prepared;
  dualwinch_controller_input input;
  dualwinch_controller_output output;
  struct machine m;
  struct held held = {{0.0, 0.0}, 0.0, 0.0};
  struct sensed sensed;
  double state[STATES] = {0.0}, queue[LONGEST_DELAY + 1][2], before[2] = {0.0, 0.0}, wanted[3];
  double square = 0.0, furthest = 0.0, largest = 0.0, smallest = INFINITY, change = 0.0, most = 0.0;
  double sample, current, load, drift = 0.0, late = 0.0, shown = 0.0, rest = DRUM / RATIO * how->preload / 2.0;
  long refused = dualwinch_controller_init(&memory, &parameters, &prepared) != 0, slack = 0, samples, k;
  long silent_from = 0, silent_to = 0, period;

  random_state = seed * 7919u + 13u;
  m = drawn(how);
  sample = (double)parameters.simulation_sample_time;
  samples = lround(50.0 / sample);
  period = lround(how->outage_period / sample);
  state[X] = -m.bias;
  for (int i = 0; i < 2; i++) {
    const struct winch *w = &m.winch[i];
    double stretch = how->preload / 2.0 * free_length(i, state[X]) / (w->modulus * AREA);
    state[THETA + i] = angle_of(w, stretch + direction(i) * state[X]);
    state[TORQUE + i] = rest;
    for (int n = 0; n <= LONGEST_DELAY; n++) queue[n][i] = rest;
  }
  current = m.current_sigma * normal(), load = m.load_sigma * normal();

  for (k = 0; k < samples; k++) {
    double t = (double)k * sample + late, off = m.bias + m.drift * drift, next_late, tension[2], error;
    pull(&m, t, state, tension);
    reference((double)k * sample, wanted);
    if (period > 0 && k % period == 0) {
      long length = lround(how->outage_length / sample * uniform(0.5, 1.5));
      silent_from = k + (long)uniform(0.0, (double)(period - length)), silent_to = silent_from + length;
    }
    sensed.x = rounded(state[X] + off + m.position_noise * normal(), m.resolution);
    if (k >= silent_from && k < silent_to) sensed.x = how->missing ? NAN : shown;
    if (isfinite(sensed.x)) shown = sensed.x;
    sensed.v = state[V] + m.speed_noise * normal();
    for (int i = 0; i < 2; i++) {
      const struct winch *w = &m.winch[i];
      double count = m.counts > 0.0 ? 2.0 * PI / (RATIO * m.counts) : 0.0;
      sensed.F[i] = tension[i] * (1.0 + w->cell_error) + w->cell_zero + m.tension_noise * normal();
      sensed.theta[i] = rounded(state[THETA + i] + w->encoder_zero / DRUM, count);
    }
    memcpy(sensed.reference, wanted, sizeof wanted);
    give(&input, &sensed);
    refused += dualwinch_controller_step(&memory, &input, &prepared, &output) != 0;

    error = state[X] + m.bias - wanted[0] - late * (wanted[1] + late * wanted[2] / 2.0);
    square += error * error;
    furthest = fmax(furthest, fabs(error));
    for (int i = 0; i < 2; i++) {
      largest = fmax(largest, tension[i]), smallest = fmin(smallest, tension[i]);
      slack += tension[i] <= 0.0;
      change += k ? fabs(tension[i] - before[i]) : 0.0;
      before[i] = tension[i];
    }

    memmove(queue[1], queue[0], LONGEST_DELAY * sizeof queue[0]);
    queue[0][0] = (double)output.tau_1, queue[0][1] = (double)output.tau_2;
    memcpy(held.asked, queue[how->delay], sizeof held.asked);
    held.current = fmax(-0.154, fmin(0.154, current)), held.load = load;
    most = fmax(most, needed(&m, wanted, &held));
    next_late = m.jitter * uniform(-1.0, 1.0);
    move(&m, t, sample + next_late - late, state, &held);
    late = next_late;
    current = go_on(current, m.current_sigma, exp(-sample / 20.0));
    load = go_on(load, m.load_sigma, exp(-sample / 5.0));
    drift = go_on(drift, 1.0, exp(-sample / 3600.0));
    if (!(state[X] >= -OVERRUN && state[X] <= TRACK + OVERRUN)) {
      k++;
      break;
    }
  }
  printf("%ld %ld %.9g %.9g %.9g %.9g %.9g %ld %.9g\n", k, refused, square / (double)k, furthest, largest, smallest,
         change / (2.0 * (double)(k - 1)), slack, most);
  fflush(stdout);
}

static struct conditions read_conditions(char **texts) {
  struct conditions how;
  how.preload = atof(texts[0]), how.spread = atof(texts[1]), how.imperfect = atof(texts[2]);
  how.noisy = atoi(texts[3]), how.delay = atoi(texts[4]), how.missing = atoi(texts[5]);
  how.outage_length = atof(texts[6]), how.outage_period = atof(texts[7]);
  return how;
}

int main(int count, char **texts) {
  struct conditions how;
  if (count != 11) return 2;
  how = read_conditions(texts + 3);
  if (how.delay < 0 || how.delay > LONGEST_DELAY) return 2;
  for (int n = 0; n < atoi(texts[2]); n++) run(strtoull(texts[1], NULL, 10) + (uint64_t)n, &how);
  return 0;
}
