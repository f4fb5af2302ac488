/* The plant of plant.h as a library, for tests that drive it without a controller. */

#include "plant.h"

int plant_states(void) { return STATES; }

/* Where in the state a quantity stands: of x, v, theta_1, omega_1, turn_1, spin_1, sag_1, bristle ... */
int plant_place(const char *name) {
  static const struct {
    const char *name;
    int place;
  } known[] = {{"x", X}, {"v", V}, {"theta", THETA}, {"omega", OMEGA}, {"torque", TORQUE}, {"turn", TURN}, {"spin", SPIN},
               {"sag", SAG}, {"sagging", SAGGING}, {"dahl", DAHL}, {"cell", CELL}, {"bristle", BRISTLE}, {"node", NODE},
               {"moving", MOVING}};
  for (size_t k = 0; k < sizeof known / sizeof *known; k++)
    if (strcmp(known[k].name, name) == 0) return known[k].place;
  return -1;
}

size_t plant_size(void) { return sizeof(struct machine); }

/* The machine of Table 1, without effects. */
void plant_nominal(struct machine *m) {
  memset(m, 0, sizeof *m);
  m->is = NO_EFFECTS;
  m->mass = 1e4, m->drag = 0.3, m->friction = 0.1, m->strouhal = 0.2;
  for (int i = 0; i < 2; i++) m->winch[i].modulus = 80e9, m->winch[i].damping = 1000.0, m->winch[i].inertia = 1.8;
}

/* An effect by its name, or a number of the machine: 0 where there is none. */
int plant_set(struct machine *m, const char *name, double value) {
  int known = set_effect(&m->is, name, strlen(name), value);
  if (strcmp(name, "mass") == 0) m->mass = value, known = 1;
  if (strcmp(name, "drag") == 0) m->drag = value, known = 1;
  if (strcmp(name, "friction") == 0) m->friction = value, known = 1;
  if (strcmp(name, "damping") == 0) m->winch[0].damping = m->winch[1].damping = value, known = 1;
  m->plain = 0;
  return known;
}

void plant_rest(const struct machine *m, double x, const double *tension, const double *torque, double *state) {
  rest(m, x, tension, torque, state);
}

void plant_move(const struct machine *m, double t, double duration, const double *torque, double *state) {
  struct held held = {{torque[0], torque[1]}, 0.0, 0.0, 0.0};
  move(m, t, duration, state, &held);
}

/* Tensions at the drums and at the vehicle, torques between the gearboxes' teeth, and the rail's friction with all else
   that acts on the vehicle from outside: seven numbers. */
void plant_forces(const struct machine *m, double t, const double *state, double *out) {
  struct held held = {{0.0, 0.0}, 0.0, 0.0, 0.0};
  struct forces f;
  pull(m, t, state, &f);
  for (int i = 0; i < 2; i++) {
    out[i] = f.rope[i][segments(m, i) - 1].tension, out[2 + i] = f.rope[i][0].tension;
    out[4 + i] = gives(m, i) ? f.gear[i].tension : 0.0;
  }
  out[6] = resistance(m, t, state[V], &held, state[X], state[BRISTLE]);
}

/* Energy in J of motion, stretch, twist and height: of ropes of constant length, none of friction. */
double plant_energy(const struct machine *m, double t, const double *state) {
  const struct held none = {{0.0, 0.0}, 0.0, 0.0, 0.0};
  struct forces f;
  struct chain c;
  double total = 0.0;
  pull(m, t, state, &f);
  assemble(m, t, state, &none, &f, &c);
  for (int k = 0; k < c.bodies; k++) total += c.mass[k] * state[c.speed[k]] * state[c.speed[k]] / 2.0;
  for (int i = 0; i < 2; i++) {
    const struct effects *is = &m->is;
    struct spans s = spans_of(m, f.length[i]);
    double k = m->winch[i].modulus * is->modulus_factor[i] * AREA / f.length[i] * segments(m, i), slope;
    for (int j = 0; j < segments(m, i); j++) total += f.rope[i][j].tension * f.rope[i][j].tension / k / 2.0;
    if (gives(m, i)) {
      double twist = state[TURN + i] - state[THETA + i] - transmission_error(is, i, state[THETA + i], &slope);
      double beyond = fmax(fabs(twist) - is->backlash[i] / 2.0, 0.0);
      total += is->gear_stiffness[i] * beyond * beyond / 2.0;
    }
    if (is->transverse_mass[i] > 0.0) {
      double moving = is->transverse_mass[i] * 8.0 / 15.0 * state[SAGGING + i] * state[SAGGING + i] / 2.0;
      total += s.number * s.span * (moving - is->submerged_weight[i] * 2.0 / 3.0 * state[SAG + i]);
    }
  }
  return total;
}
