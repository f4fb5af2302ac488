/* The plant of machine.c: vehicle, ropes, winches and motors, written by hand from the specification and from textbooks,
   with the effects of effects.h. It shares nothing with the product.

   Each side is a chain: rotor - gearbox - drum - rope in segments - vehicle. A rope without mass is one segment. Nodes
   between segments move along the rope towards the drum, as does the rope's end at the vehicle. */

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "effects.h"

#define LARGEST_SEGMENTS 32
#define NODES (LARGEST_SEGMENTS - 1)
#define MOST_NEWTON 6

static const double PI = 3.14159265358979323846;
static const double DRUM = 0.8, RATIO = 36.0, AREA = 4.52e-4, TRACK = 50.0, OFFSET = 0.5, OVERRUN = 0.25;
static const double RAIL_LOAD = 4900.0, RAIL_SPEED = 0.01, HALF_WATER = 0.5 * 1000.0 * 6.0, HULL = 2.0, VORTICES = 0.2;
static const double DRUM_SPEED = 0.01, LAPS = 20.0, CREEPING = 60.0, WAVES = 6.0;
static const double WATER = 1000.0, SHORTEST = 0.05;

/* ---- effects by name ---- */

#define EACH_FIELD(name, value) double name[2];
#define ONE_FIELD(name, value) double name;
#define EACH_DEFAULT(name, value) {value, value},
#define ONE_DEFAULT(name, value) value,
#define EACH_NAME(name, value) {#name, offsetof(struct effects, name), 2},
#define ONE_NAME(name, value) {#name, offsetof(struct effects, name), 1},

struct effects {
  EFFECTS(EACH_FIELD, ONE_FIELD)
};

static const struct effects NO_EFFECTS = {EFFECTS(EACH_DEFAULT, ONE_DEFAULT)};

/* Set what `text`, as in name=value, says, of a name of `length` characters: 0 where there is no such effect. */
static int set_effect(struct effects *effects, const char *name, size_t length, double value) {
  static const struct {
    const char *name;
    size_t offset;
    int count;
  } known[] = {EFFECTS(EACH_NAME, ONE_NAME)};
  for (size_t k = 0; k < sizeof known / sizeof *known; k++) {
    double *field = (double *)((char *)effects + known[k].offset);
    size_t own = strlen(known[k].name);
    if (length < own || strncmp(name, known[k].name, own) != 0) continue;
    if (length == own) {
      for (int i = 0; i < known[k].count; i++) field[i] = value;
      return 1;
    }
    if (known[k].count == 2 && length == own + 2 && name[own] == '_' && (name[own + 1] == '1' || name[own + 1] == '2')) {
      field[name[own + 1] - '1'] = value;
      return 1;
    }
  }
  return 0;
}

/* Whether none is on that changes the plant's equations: those of sensors, of the damping and of overloads do not. */
static int plain(const struct effects *effects) {
  struct effects rest = NO_EFFECTS;
  rest.wheel_error = effects->wheel_error, rest.torque_step = effects->torque_step;
  rest.slack_below = effects->slack_below, rest.speed_damping = effects->speed_damping;
  rest.speed_lag = effects->speed_lag, rest.speed_noise = effects->speed_noise;
  rest.shedding_by_way = effects->shedding_by_way, rest.shedding_phase = effects->shedding_phase;
  rest.learnt_wheel = effects->learnt_wheel, rest.learnt_modulus = effects->learnt_modulus;
  rest.position_late = effects->position_late, rest.position_fault = effects->position_fault;
  rest.fault_start = effects->fault_start, rest.fault_length = effects->fault_length;
  rest.fault_period = effects->fault_period, rest.wheel_slip = effects->wheel_slip;
  rest.drift_time = effects->drift_time;
  rest.learnt_gear = effects->learnt_gear, rest.learnt_sag = effects->learnt_sag;
  rest.push_force = effects->push_force, rest.push_start = effects->push_start, rest.push_length = effects->push_length;
  rest.payload_mass = effects->payload_mass, rest.payload_drag = effects->payload_drag;
  rest.payload_start = effects->payload_start, rest.base_speed = effects->base_speed;
  rest.overload_time = effects->overload_time;
  for (int i = 0; i < 2; i++) {
    rest.encoder_slip[i] = effects->encoder_slip[i], rest.cell_drift[i] = effects->cell_drift[i];
    rest.most_torque[i] = effects->most_torque[i], rest.rated_torque[i] = effects->rated_torque[i];
    rest.dropout_start[i] = effects->dropout_start[i], rest.dropout_length[i] = effects->dropout_length[i];
  }
  return memcmp(&rest, effects, sizeof rest) == 0;
}

/* ---- the machine ---- */

struct winch {
  double inertia, radius_error, eccentricity, run_out_angle, layer, torque_error, ripple, ripple_angle;
  double modulus, damping, creep, encoder_zero, cell_error, cell_zero;
};

struct machine {
  double mass, drag, friction, strouhal, motor_lag, bias, drift, jitter;
  double position_noise, resolution, speed_noise, tension_noise, counts, current_sigma, load_sigma, coulomb;
  struct winch winch[2];
  struct effects is;
  int plain; /* whether it is that of sea or rig */
};

struct held {
  double asked[2], current, load, push; /* N m, m/s, N, N against the motion */
};

/* Position, two drum angles, their speeds, two motor torques; then, of a machine with effects: rotor angles and speeds (of
   a gearbox that gives, as at the drum), amplitudes of the sag and their rates, Dahl's states, readings of the load
   cells, LuGre's bristle, the ropes' mean tensions in the step before, and positions and speeds of the nodes of both ropes, from the vehicle on. */
enum {
  X,
  THETA,
  V = 3,
  OMEGA,
  TORQUE = 6,
  PLAIN_STATES = 8,
  TURN = 8,
  SPIN = 10,
  SAG = 12,
  SAGGING = 14,
  DAHL = 16,
  CELL = 18,
  BRISTLE = 20,
  MEAN = 21,
  NODE = 23,
  MOVING = NODE + 2 * NODES,
  STATES = MOVING + 2 * NODES
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

static int segments(const struct machine *m, int i) { return m->is.rope_mass[i] > 0.0 ? (int)m->is.segments : 1; }

static int gives(const struct machine *m, int i) { return m->is.gear_stiffness[i] > 0.0; }

/* ---- sag: spans between rollers, each a parabola y = a 4 s (1 - s) of the first mode (Irvine 1981) ---- */

struct spans {
  double span, number; /* m; of whole spans, with the cube of the last one's share, for Sum s^3 */
};

/* Rollers stand every so many metres from the winch on; the last span ends at the vehicle. */
static struct spans spans_of(const struct machine *m, double length) {
  double spacing = m->is.roller_spacing, whole, share;
  struct spans found = {length, 1.0};
  if (spacing > 0.0) {
    whole = floor(length / spacing), share = length / spacing - whole;
    found.span = spacing, found.number = whole + share * share * share;
  }
  return found;
}

/* By how much sag shortens the chord, from the amplitude of a whole span; Int y'^2/2 = 8/3 a^2/s. */
static double shortening(const struct spans *s, double sag) { return s->number * 8.0 / 3.0 * sag * sag / s->span; }

/* Tension where stretch = T/k - w^2 Sum s^3/(24 T^2), and its slope by the stretch: Ernst's modulus (Newton; monotone). */
static double quasi_static(double k, double pull, double stretch, double *slope) {
  /* T^3 - k stretch T^2 - k pull = 0 */
  double s = k * stretch, b = k * pull, T;
  T = s > 0.0 ? s + cbrt(b) : fmin(cbrt(b), s < 0.0 ? sqrt(-b / s) : cbrt(b));
  for (int n = 0; n < 8; n++) T -= ((T - s) * T * T - b) / (T * (3.0 * T - 2.0 * s));
  *slope = k / (1.0 + 2.0 * b / (T * T * T));
  return T;
}

/* ---- forces ---- */

struct link {
  double tension, by_stretch, by_rate; /* N; its slopes, N/m and N s/m */
};

/* What forces come to at a state: of each side the rope, as its segments from the vehicle on, and the gearbox. */
struct forces {
  struct link rope[2][LARGEST_SEGMENTS], gear[2];
  double radius[2], length[2], mean[2], stretch_rate[2], gear_slope[2]; /* m, m, N, m/s, twist by drum angle */
  double over[2]; /* tension at the drum over that beyond its sheave */
};

/* Stretch in m after which Dahl's force has changed by 1 - 1/e of the way. */
static double dahl_length(const struct machine *m, double length) { return m->is.dahl_strain * length; }

/* Damping of a whole rope in N s/m. */
static double rope_damping(const struct machine *m, int i, double length, double stiffness) {
  const struct effects *is = &m->is;
  double c = m->winch[i].damping * is->damping_factor[i];
  if (is->damping_length > 0.0) c *= is->damping_length / length;
  if (is->loss_factor[i] > 0.0) {
    double inertia = m->winch[i].inertia * is->inertia_factor[i] + is->drum_inertia[i] +
                     is->rotor_inertia[i] * RATIO * RATIO;
    double moving = inertia / (DRUM * DRUM) + 4.0 / (PI * PI) * is->rope_mass[i] * length;
    c += is->loss_factor[i] * sqrt(stiffness * moving);
  }
  return c;
}

static void pull_rope(const struct machine *m, double t, const double *state, int i, struct forces *f) {
  const struct winch *w = &m->winch[i];
  const struct effects *is = &m->is;
  int n = segments(m, i);
  double length = free_length(i, state[X]);
  double longer = w->creep * (1.0 - exp(-t / CREEPING)), lengthening = w->creep * exp(-t / CREEPING) / CREEPING;
  double at = direction(i) * state[X], moving = direction(i) * state[V], excess = 0.0, growing = 0.0, hysteresis = 0.0;
  double r = radius(w, state[THETA + i]), total, modulus, k, c, firmer = 0.0;
  struct spans s = {1.0, 0.0};
  f->radius[i] = r;
  if (m->plain) {
    double stretch = wound(w, state[THETA + i]) - at - longer;
    double rate = r * state[OMEGA + i] - moving - lengthening;
    double force = w->modulus * AREA / length * stretch + w->damping * rate;
    f->rope[i][0].tension = stretch > 0.0 && force > 0.0 ? force : 0.0;
    return;
  }
  length = fmax(length, SHORTEST);
  f->length[i] = length;
  modulus = w->modulus * is->modulus_factor[i] * AREA;
  k = modulus / length * n, c = rope_damping(m, i, length, modulus / length) * n;
  if (is->submerged_weight[i] > 0.0) s = spans_of(m, length);
  if (is->transverse_mass[i] > 0.0) {
    excess = shortening(&s, state[SAG + i]) / n;
    growing = s.number * 16.0 / 3.0 * state[SAG + i] / s.span * state[SAGGING + i] / n;
  }
  total = r * state[OMEGA + i] - moving - lengthening;
  f->stretch_rate[i] = total;
  if (is->dahl_force[i] > 0.0) {
    double way = dahl_length(m, length), to = total < 0.0 ? -1.0 : 1.0;
    hysteresis = is->dahl_force[i] * state[DAHL + i];
    firmer = is->dahl_force[i] / way * (1.0 - to * state[DAHL + i]) * n;
  }
  f->mean[i] = 0.0;
  for (int j = 0; j < n; j++) {
    int last = j == n - 1;
    double next = last ? wound(w, state[THETA + i]) : state[NODE + i * NODES + j];
    double speed = last ? r * state[OMEGA + i] : state[MOVING + i * NODES + j];
    double stretch = next - at - longer / n, rate = speed - moving - lengthening / n, force, stiff = k, damp = c;
    struct link *link = &f->rope[i][j];
    if (is->submerged_weight[i] > 0.0 && is->transverse_mass[i] <= 0.0) {
      double weight = is->submerged_weight[i], pull = weight * weight * s.number * s.span * s.span * s.span / 24.0 / n;
      force = quasi_static(k, pull, stretch, &stiff);
      damp = c * stiff / k;
      force += damp * rate + hysteresis;
    } else {
      force = k * (stretch + excess) + c * (rate + growing) + hysteresis;
      if (is->submerged_weight[i] <= 0.0 && stretch <= 0.0) force = 0.0;
    }
    link->tension = force > 0.0 ? force : 0.0;
    link->by_stretch = force > 0.0 ? stiff + firmer : 0.0;
    link->by_rate = force > 0.0 ? damp : 0.0;
    f->mean[i] += link->tension / n;
    at = next, moving = speed;
  }
}

static double transmission_error(const struct effects *is, int i, double theta, double *slope) {
  double size = is->transmission_error[i], angle = is->transmission_angle[i];
  *slope = size * (6.0 * cos(6.0 * theta + angle) + 36.0 * cos(36.0 * theta + 3.0 * angle));
  return size * (sin(6.0 * theta + angle) + sin(36.0 * theta + 3.0 * angle));
}

/* Torque from rotor to drum, at the drum. Between flanks there is none. */
static void pull_gear(const struct machine *m, const double *state, int i, struct forces *f) {
  const struct effects *is = &m->is;
  double slope, error = transmission_error(is, i, state[THETA + i], &slope), half = is->backlash[i] / 2.0;
  double twist = state[TURN + i] - state[THETA + i] - error;
  double rate = state[SPIN + i] - state[OMEGA + i] * (1.0 + slope);
  double beyond = twist > half ? twist - half : twist < -half ? twist + half : 0.0;
  struct link *link = &f->gear[i];
  int touch = half <= 0.0 || beyond != 0.0;
  f->gear_slope[i] = 1.0 + slope;
  link->by_stretch = touch ? is->gear_stiffness[i] : 0.0;
  link->by_rate = touch ? is->gear_damping[i] : 0.0;
  link->tension = link->by_stretch * beyond + link->by_rate * rate;
  /* teeth push, they do not stick */
  if (half > 0.0 && link->tension * beyond < 0.0) link->tension = link->by_rate = 0.0;
}

static void pull(const struct machine *m, double t, const double *state, struct forces *f) {
  for (int i = 0; i < 2; i++) {
    f->over[i] = exp(m->is.sheave[i] * tanh(state[OMEGA + i] / DRUM_SPEED)); /* capstan: Euler, Eytelwein */
    pull_rope(m, t, state, i, f);
    if (gives(m, i)) pull_gear(m, state, i, f);
  }
}

/* Coulomb's friction and, with bristles, LuGre's (Canudas de Wit et al. 1995), over the friction coefficient's force. */
static double stribeck(const struct effects *is, double v) {
  double share = v / is->stribeck_speed;
  return 1.0 + (is->break_away - 1.0) * exp(-share * share);
}

static double bristle_rate(const struct effects *is, double sliding, double v, double bristle) {
  return v - is->bristle_stiffness * fabs(v) / (sliding * stribeck(is, v)) * bristle;
}

/* A bristle after a time h at a speed. */
static double bristle_after(const struct effects *is, double sliding, double v, double bristle, double h) {
  double passed = is->bristle_stiffness * fabs(v) / (sliding * stribeck(is, v)) * h;
  return bristle * exp(-passed) + v * h * (passed > 1e-9 ? -expm1(-passed) / passed : 1.0);
}

/* Force against the vehicle's motion in N. */
static double resistance(const struct machine *m, double t, double v, const struct held *held, double x, double bristle) {
  const struct effects *is = &m->is;
  double through = v - held->current, passed = is->shedding_by_way > 0.0 ? x : v * t;
  double shedding = 2.0 * PI * m->strouhal / HULL * passed + is->shedding_phase;
  double sliding = m->friction * (RAIL_LOAD + held->load);
  double water = HALF_WATER * m->drag * (through * fabs(through) - VORTICES * v * fabs(v) * sin(shedding)), rubbing;
  water += held->push;
  if (m->plain) return sliding * tanh(v / RAIL_SPEED) + water;
  if (is->bristle_stiffness > 0.0) {
    rubbing = is->bristle_stiffness * bristle + is->bristle_damping * bristle_rate(is, sliding, v, bristle);
  } else {
    rubbing = sliding * stribeck(is, v) * tanh(v / RAIL_SPEED);
  }
  return rubbing + water + RAIL_LOAD * (is->rail_tilt + is->rail_wave * sin(2.0 * PI * x / is->rail_wavelength));
}

/* Friction of a stretch of rope along, in N, and its slope by the speed: rollers and water. */
static double dragging(const struct machine *m, int i, double length, double v, double *slope) {
  const struct effects *is = &m->is;
  double rollers = is->roller_friction * is->submerged_weight[i] * length;
  double water = 0.5 * WATER * is->skin_friction * PI * is->diameter * length, shape;
  *slope = 0.0;
  if (rollers <= 0.0 && water <= 0.0) return 0.0;
  shape = tanh(v / RAIL_SPEED);
  *slope = rollers * (1.0 - shape * shape) / RAIL_SPEED + 2.0 * water * fabs(v);
  return rollers * shape + water * v * fabs(v);
}

static double lag(const struct machine *m, int i) { return m->motor_lag * m->is.lag_factor[i]; }

static double motor_torque(const struct machine *m, const double *state, const struct held *held, int i) {
  const struct winch *w = &m->winch[i];
  double shaft = gives(m, i) ? state[TURN + i] : state[THETA + i];
  double wave = w->ripple * sin(w->ripple_angle + WAVES * RATIO * shaft);
  return (lag(m, i) > 0.0 ? state[TORQUE + i] : held->asked[i]) * (1.0 + w->torque_error + wave);
}

static double rope_on_drum(const struct machine *m, int i, double length) {
  if (m->is.wound <= 0.0) return 0.0;
  return m->is.rope_mass[i] * (m->is.spare_length + TRACK + 2.0 * OFFSET - length);
}

/* Acceleration across of a span's amplitude: its mode has 8/15 of the mass, 2/3 of the weight, 16/3 of T/s, 16/35 of drag. */
static double sag_acceleration(const struct machine *m, int i, double pull, double length, const double *state) {
  const struct effects *is = &m->is;
  struct spans s = spans_of(m, length);
  double a = state[SAG + i], rate = state[SAGGING + i];
  double drag = 0.5 * WATER * is->transverse_drag * is->diameter * rate * fabs(rate) * 16.0 / 35.0;
  double up = pull * 16.0 / 3.0 * a / (s.span * s.span);
  return (is->submerged_weight[i] * 2.0 / 3.0 - up - drag) / (is->transverse_mass[i] * 8.0 / 15.0);
}

/* ---- chains: bodies from the rotor of winch 1 over the vehicle to that of winch 2, tied to their neighbours alone ---- */

#define BODIES (2 * LARGEST_SEGMENTS + 5)

struct chain {
  int bodies, position[BODIES], speed[BODIES];                        /* where in the state */
  double mass[BODIES], force[BODIES], by_position[BODIES][3], by_speed[BODIES][3]; /* slopes by body before, own, next */
};

static void body(struct chain *c, int k, int position, int speed, double mass) {
  c->position[k] = position, c->speed[k] = speed, c->mass[k] = mass, c->force[k] = 0.0;
  for (int n = 0; n < 3; n++) c->by_position[k][n] = c->by_speed[k][n] = 0.0;
}

/* A link between neighbours, whose stretch is the sum of their positions times `here` and `there`. */
static void tie(struct chain *c, const struct link *link, int k, double here, int next, double there) {
  double slope[2] = {link->by_stretch, link->by_rate};
  int up = next > k;
  c->force[k] -= here * link->tension, c->force[next] -= there * link->tension;
  for (int n = 0; n < 2; n++) {
    double(*by)[3] = n ? c->by_speed : c->by_position;
    by[k][1] -= here * here * slope[n], by[k][up ? 2 : 0] -= here * there * slope[n];
    by[next][up ? 0 : 2] -= here * there * slope[n], by[next][1] -= there * there * slope[n];
  }
}

/* Torques of motor and frictions on rotor and drum. */
static void drive(const struct machine *m, const double *state, const struct held *held, const struct forces *f, int i,
                  struct chain *c, int rotor, int drum) {
  double torque = RATIO * motor_torque(m, state, held, i), shape = tanh(state[OMEGA + i] / DRUM_SPEED);
  double through = gives(m, i) ? f->gear[i].tension : torque;
  double rubbing = m->coulomb + (1.0 - m->is.gear_efficiency[i]) * fabs(through);
  double sliding = m->is.sheave[i] * f->over[i] * f->rope[i][segments(m, i) - 1].tension * f->radius[i];
  c->force[rotor] += torque;
  c->force[drum] -= (f->over[i] - 1.0) * f->rope[i][segments(m, i) - 1].tension * f->radius[i];
  c->by_speed[drum][1] -= sliding * (1.0 - shape * shape) / DRUM_SPEED;
  c->force[drum] -= rubbing * shape;
  c->by_speed[drum][1] -= rubbing * (1.0 - shape * shape) / DRUM_SPEED;
}

/* Friction of a length of rope along on a body that moves `reach` times the rope's way. */
static void drag_along(const struct machine *m, const double *state, int i, double length, double reach, struct chain *c,
                       int k) {
  double slope, force = dragging(m, i, length, reach * state[c->speed[k]], &slope);
  c->force[k] -= reach * force, c->by_speed[k][1] -= reach * reach * slope;
}

static double drum_inertia(const struct machine *m, int i) {
  return m->winch[i].inertia * m->is.inertia_factor[i] + m->is.drum_inertia[i];
}

static double rotor_inertia(const struct machine *m, int i) { return m->is.rotor_inertia[i] * RATIO * RATIO; }

/* All bodies, their masses, the forces on them and the forces' slopes. */
static void assemble(const struct machine *m, double t, const double *state, const struct held *held,
                     const struct forces *f, struct chain *c) {
  const double small = 1e-6;
  int n[2] = {segments(m, 0), segments(m, 1)}, vehicle = n[0] + gives(m, 0);
  double push = resistance(m, t, state[V], held, state[X], state[BRISTLE]);
  /* bodies of winch 1 stand before the vehicle's, in the opposite order */
  c->bodies = vehicle + 1 + n[1] + gives(m, 1);
  body(c, vehicle, X, V, m->mass);
  for (int i = 0; i < 2; i++) {
    int towards = i ? 1 : -1, drum = vehicle + towards * n[i], rotor = drum + towards * gives(m, i);
    double r = f->radius[i], part = f->length[i] / n[i], share = m->is.rope_mass[i] * part, end = direction(i);
    double inertia = drum_inertia(m, i) + (rope_on_drum(m, i, f->length[i]) + share / 2.0) * r * r;
    c->mass[vehicle] += share / 2.0;
    for (int j = 0; j < n[i] - 1; j++) {
      int k = vehicle + towards * (j + 1);
      body(c, k, NODE + i * NODES + j, MOVING + i * NODES + j, share);
      drag_along(m, state, i, part, 1.0, c, k);
    }
    body(c, drum, THETA + i, OMEGA + i, inertia + (gives(m, i) ? 0.0 : rotor_inertia(m, i)));
    if (gives(m, i)) body(c, rotor, TURN + i, SPIN + i, rotor_inertia(m, i));
    drag_along(m, state, i, part / 2.0, end, c, vehicle);
    drag_along(m, state, i, part / 2.0, r, c, drum);
    for (int j = 0; j < n[i]; j++) {
      int inner = vehicle + towards * j;
      tie(c, &f->rope[i][j], inner, j ? -1.0 : -end, inner + towards, j < n[i] - 1 ? 1.0 : r);
    }
    if (gives(m, i)) tie(c, &f->gear[i], drum, -f->gear_slope[i], rotor, 1.0);
    drive(m, state, held, f, i, c, rotor, drum);
  }
  c->force[vehicle] -= push;
  c->by_speed[vehicle][1] -= (resistance(m, t, state[V] + small, held, state[X], state[BRISTLE]) - push) / small;
}

/* ---- motion ---- */

static void slope_plain(const struct machine *m, double t, const double *state, const struct held *held, double *rate) {
  struct forces f;
  double v = state[V];
  pull(m, t, state, &f);
  rate[X] = v;
  rate[V] = (f.rope[0][0].tension - f.rope[1][0].tension - resistance(m, t, v, held, state[X], 0.0)) / m->mass;
  for (int i = 0; i < 2; i++) {
    double omega = state[OMEGA + i], torque = motor_torque(m, state, held, i);
    double opposing = f.radius[i] * f.rope[i][0].tension + m->coulomb * tanh(omega / DRUM_SPEED);
    rate[THETA + i] = omega;
    rate[OMEGA + i] = (RATIO * torque - opposing) / m->winch[i].inertia;
    rate[TORQUE + i] = lag(m, i) > 0.0 ? (held->asked[i] - state[TORQUE + i]) / lag(m, i) : 0.0;
  }
}

static double cell_tension(const struct machine *m, const struct forces *f, int i) {
  return m->is.cell_at_vehicle > 0.0 ? f->rope[i][0].tension : f->rope[i][segments(m, i) - 1].tension * f->over[i];
}

static void slope_whole(const struct machine *m, double t, const double *state, const struct held *held, double *rate) {
  struct forces f;
  struct chain c;
  double sliding = m->friction * (RAIL_LOAD + held->load);
  pull(m, t, state, &f);
  assemble(m, t, state, held, &f, &c);
  for (int k = 0; k < STATES; k++) rate[k] = 0.0;
  for (int k = 0; k < c.bodies; k++) rate[c.position[k]] = state[c.speed[k]], rate[c.speed[k]] = c.force[k] / c.mass[k];
  for (int i = 0; i < 2; i++) {
    double to = f.stretch_rate[i] < 0.0 ? -1.0 : 1.0;
    rate[TORQUE + i] = lag(m, i) > 0.0 ? (held->asked[i] - state[TORQUE + i]) / lag(m, i) : 0.0;
    rate[CELL + i] = 2.0 * PI * m->is.cell_bandwidth * (cell_tension(m, &f, i) - state[CELL + i]);
    if (m->is.dahl_force[i] > 0.0)
      rate[DAHL + i] = f.stretch_rate[i] / dahl_length(m, f.length[i]) * (1.0 - to * state[DAHL + i]);
    if (m->is.transverse_mass[i] > 0.0) {
      rate[SAG + i] = state[SAGGING + i];
      rate[SAGGING + i] = sag_acceleration(m, i, f.mean[i], f.length[i], state);
    }
  }
  if (m->is.bristle_stiffness > 0.0) rate[BRISTLE] = bristle_rate(&m->is, sliding, state[V], state[BRISTLE]);
}

/* The classical Runge-Kutta step of a number, from t on. */
static void runge_kutta(const struct machine *m, double t, int step, double h, double *state, const struct held *held) {
  static const double reach[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
  double rate[STATES] = {0.0}, at[STATES], change[STATES] = {0.0};
  int count = m->plain ? PLAIN_STATES : STATES;
  for (int stage = 0; stage < 4; stage++) {
    for (int k = 0; k < count; k++) at[k] = state[k] + reach[stage] * h * rate[k];
    (m->plain ? slope_plain : slope_whole)(m, t + (step + reach[stage]) * h, at, held, rate);
    for (int k = 0; k < count; k++) change[k] += weight[stage] * h * rate[k];
  }
  for (int k = 0; k < count; k++) state[k] += change[k];
}

/* Change of speeds in a step h: (M - h/2 dF/dv - h^2/4 dF/dx) change = right, by elimination in the chain's order. */
static void solve(const struct chain *c, double h, const double *right, double *change) {
  double upper[BODIES], pivot;
  for (int k = 0; k < c->bodies; k++) {
    double row[3];
    for (int n = 0; n < 3; n++) row[n] = -h / 2.0 * c->by_speed[k][n] - h * h / 4.0 * c->by_position[k][n];
    row[1] += c->mass[k];
    pivot = k ? row[1] - row[0] * upper[k - 1] : row[1];
    upper[k] = row[2] / pivot;
    change[k] = (right[k] - (k ? row[0] * change[k - 1] : 0.0)) / pivot;
  }
  for (int k = c->bodies - 2; k >= 0; k--) change[k] -= upper[k] * change[k + 1];
}

/* Whether the same ropes are taut and the same teeth touch. */
static int touch_alike(const struct machine *m, const struct forces *one, const struct forces *other) {
  for (int i = 0; i < 2; i++) {
    if (gives(m, i) && (one->gear[i].by_stretch > 0.0) != (other->gear[i].by_stretch > 0.0)) return 0;
    for (int j = 0; j < segments(m, i); j++)
      if ((one->rope[i][j].tension > 0.0) != (other->rope[i][j].tension > 0.0)) return 0;
  }
  return 1;
}

/* A step of the implicit midpoint rule (second order, A-stable) by one Newton step, and more where a rope becomes taut or
   slack or teeth meet or part. What is no body's motion is taken to the middle beforehand and to the end afterwards; lags
   of first order exactly. */
static void midpoint(const struct machine *m, double t, double h, double *state, const struct held *held) {
  const struct effects *is = &m->is;
  double at[STATES], change[BODIES], right[BODIES], half = h / 2.0, sliding = m->friction * (RAIL_LOAD + held->load);
  struct forces f;
  struct chain c;
  memcpy(at, state, sizeof at);
  for (int i = 0; i < 2; i++) {
    if (lag(m, i) > 0.0)
      at[TORQUE + i] = held->asked[i] + (state[TORQUE + i] - held->asked[i]) * exp(-half / lag(m, i));
    at[THETA + i] += half * state[OMEGA + i];
    if (gives(m, i)) at[TURN + i] += half * state[SPIN + i];
    for (int j = 0; j < segments(m, i) - 1; j++) at[NODE + i * NODES + j] += half * state[MOVING + i * NODES + j];
    if (is->transverse_mass[i] > 0.0) {
      double length = fmax(free_length(i, state[X]), SHORTEST);
      at[SAG + i] += half * state[SAGGING + i];
      at[SAGGING + i] += half * sag_acceleration(m, i, state[MEAN + i], length, state);
    }
  }
  at[X] += half * state[V];
  for (int i = 0; i < 2; i++) {
    if (is->dahl_force[i] > 0.0) {
      double length = fmax(free_length(i, at[X]), SHORTEST);
      double rate = radius(&m->winch[i], at[THETA + i]) * at[OMEGA + i] - direction(i) * at[V];
      double to = rate < 0.0 ? -1.0 : 1.0;
      at[DAHL + i] = to + (state[DAHL + i] - to) * exp(-fabs(rate) * half / dahl_length(m, length));
    }
  }
  if (is->bristle_stiffness > 0.0) at[BRISTLE] = bristle_after(is, sliding, at[V], state[BRISTLE], half);
  pull(m, t + half, at, &f);
  for (int again = 1; again > 0;) {
    struct forces before = f;
    assemble(m, t + half, at, held, &f, &c);
    for (int k = 0; k < c.bodies; k++) right[k] = h * c.force[k] - (again > 1 ? c.mass[k] * change[k] : 0.0);
    solve(&c, h, right, right);
    for (int k = 0; k < c.bodies; k++) {
      change[k] = right[k] + (again > 1 ? change[k] : 0.0);
      at[c.speed[k]] += right[k] / 2.0, at[c.position[k]] += h / 4.0 * right[k];
    }
    pull(m, t + half, at, &f);
    again = again < MOST_NEWTON && !touch_alike(m, &before, &f) ? again + 1 : 0;
  }
  for (int k = 0; k < c.bodies; k++) {
    state[c.position[k]] += h * (state[c.speed[k]] + change[k] / 2.0);
    state[c.speed[k]] += change[k];
  }
  for (int i = 0; i < 2; i++) {
    if (lag(m, i) > 0.0)
      state[TORQUE + i] = held->asked[i] + (state[TORQUE + i] - held->asked[i]) * exp(-h / lag(m, i));
    if (is->transverse_mass[i] > 0.0) {
      double rate = state[SAGGING + i];
      state[SAGGING + i] += h * sag_acceleration(m, i, f.mean[i], f.length[i], at);
      state[SAG + i] += half * (rate + state[SAGGING + i]);
      state[MEAN + i] = f.mean[i];
    }
    if (is->dahl_force[i] > 0.0) {
      double to = f.stretch_rate[i] < 0.0 ? -1.0 : 1.0;
      state[DAHL + i] = to + (state[DAHL + i] - to) * exp(-fabs(f.stretch_rate[i]) * h / dahl_length(m, f.length[i]));
    }
    if (is->cell_bandwidth > 0.0) {
      double now = cell_tension(m, &f, i);
      state[CELL + i] = now + (state[CELL + i] - now) * exp(-2.0 * PI * is->cell_bandwidth * h);
    }
  }
  if (is->bristle_stiffness > 0.0) state[BRISTLE] = bristle_after(is, sliding, at[V], state[BRISTLE], h);
}

static int substeps(const struct machine *m) {
  if (!m->plain && m->is.substeps > 0.0) return (int)m->is.substeps;
  return m->plain || m->is.integrator <= 0.0 ? 64 : 16;
}

/* Go on for a duration, in equal steps. */
static void move(const struct machine *m, double t, double duration, double *state, const struct held *held) {
  int steps = substeps(m);
  double h = duration / steps;
  for (int step = 0; step < steps; step++) {
    if (m->plain || m->is.integrator <= 0.0) {
      runge_kutta(m, t, step, h, state, held);
    } else {
      midpoint(m, t + step * h, h, state, held);
    }
  }
}

/* ---- rest ---- */

/* At rest at a position with tensions in N, and with the motors' torques in N m. */
static void rest(const struct machine *m, double x, const double *tension, const double *torque, double *state) {
  memset(state, 0, STATES * sizeof *state);
  state[X] = x;
  for (int i = 0; i < 2; i++) {
    const struct winch *w = &m->winch[i];
    const struct effects *is = &m->is;
    double length = free_length(i, x), stretch = tension[i] * length / (w->modulus * AREA), slope;
    if (!m->plain) {
      struct spans s = spans_of(m, length);
      double weight = is->submerged_weight[i];
      stretch /= is->modulus_factor[i];
      state[SAG + i] = weight * s.span * s.span / (8.0 * tension[i]);
      stretch -= shortening(&s, state[SAG + i]);
      state[CELL + i] = state[MEAN + i] = tension[i];
    }
    state[THETA + i] = angle_of(w, stretch + direction(i) * x);
    for (int j = 0; j < segments(m, i) - 1; j++)
      state[NODE + i * NODES + j] = direction(i) * x + (j + 1.0) / segments(m, i) * stretch;
    if (gives(m, i)) {
      double load = tension[i] * radius(w, state[THETA + i]);
      state[TURN + i] = state[THETA + i] + transmission_error(is, i, state[THETA + i], &slope);
      state[TURN + i] += load / is->gear_stiffness[i] + is->backlash[i] / 2.0;
    }
    state[TORQUE + i] = torque[i];
  }
}
