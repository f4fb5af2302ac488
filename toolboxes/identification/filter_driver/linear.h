/* The system of codegen/sampled.py with its slopes. Comes after vectors.h, elementary.h, lanes.h, the sizes and the
   functions of codegen/drivers/prediction.py with derive(parameters, derived):
     NAME           sense, prepare, move, one_step
     linear_NAME    the same with slopes by the state, for `move` also by the fitted parameters
     NAME_slopes    slopes by the state and by the fitted parameters, over arrays of stride LANES; not of `move`
   Tangents are matrices, row by row, padded with zeros to whole vectors: COLUMNS directions by the state, or WAYS, one for
   each fitted parameter and one more.
   NAME_BY_STATE and NAME_BY_ALL are the statements of codegen/drivers/tangents.py for the tangents of the outputs. */

#include <math.h>

enum { COLUMNS = WHOLE_VECTORS(STATES), WAYS = WHOLE_VECTORS(FITTED + 1) };

/* Slopes of the transition from a sample to the next. */
typedef struct {
  int in_one_step; /* whether by the one-step update, else part by part */
  double prepare[LINEAR_PREPARE_SLOPES + 1], one_step[LINEAR_ONE_STEP_SLOPES + 1];
  double move[PARTS * LINEAR_MOVE_SLOPES + 1];
} Slopes;

/* a += factor * b, `count` numbers */
static inline void add(double *restrict a, double factor, const double *restrict b, int count) {
  for (int i = 0; i < count; ++i) a[i] += factor * b[i];
}

/* out (rows × columns) += a (rows × inner) b (inner × columns); rows of a have the stride `stride` */
static inline void add_product(double *restrict out, const double *restrict a, int stride, const double *restrict b,
                               int rows, int inner, int columns) {
  for (int i = 0; i < rows; ++i)
    for (int k = 0; k < inner; ++k)
      if (a[i * stride + k] != 0) add(out + i * columns, a[i * stride + k], b + k * columns, columns);
}

/* a += factor * b, rows of COLUMNS; with explicit vectors, or compilers merge several rows */
static inline void add_row(double *a, double factor, const double *b) {
  for (int v = 0; v < COLUMNS / VECTOR; ++v) ((Vector *)a)[v] += factor * ((const Vector *)b)[v];
}

static inline int absent(double reading) { return overflow(reading) >> 63; }

static inline void put_identity(double *matrix) {
  memset(matrix, 0, STATES * COLUMNS * sizeof *matrix);
  for (int i = 0; i < STATES; ++i) matrix[i * COLUMNS + i] = 1;
}

IN_LANES sense_columns(const double *restrict slopes, const void *states, void *readings) {
  enum { VECTORS = COLUMNS / VECTOR };
  EACH_GROUP {
    const Vector *restrict state_tangent = (const Vector *)states + at;
    Vector *restrict reading_tangent = (Vector *)readings + at;
    SENSE_BY_STATE
  }
}

IN_LANES prepare_columns(const double *restrict slopes, const void *states, void *rests, void *holds) {
  enum { VECTORS = COLUMNS / VECTOR };
  EACH_GROUP {
    const Vector *restrict state_tangent = (const Vector *)states + at;
    Vector *restrict rest_tangent = (Vector *)rests + at, *restrict hold_tangent = (Vector *)holds + at;
    PREPARE_BY_STATE
  }
}

IN_LANES move_columns(const double *restrict slopes, const void *motions, const void *holds, void *nexts) {
  enum { VECTORS = COLUMNS / VECTOR };
  EACH_GROUP {
    const Vector *restrict motion_tangent = (const Vector *)motions + at;
    const Vector *restrict hold_tangent = (const Vector *)holds + at;
    Vector *restrict next_motion_tangent = (Vector *)nexts + at;
    MOVE_BY_STATE
  }
}

#if HAS_ONE_STEP
IN_LANES one_step_columns(const double *restrict slopes, const void *motions, const void *holds, void *nexts) {
  enum { VECTORS = COLUMNS / VECTOR };
  EACH_GROUP {
    const Vector *restrict motion_tangent = (const Vector *)motions + at;
    const Vector *restrict hold_tangent = (const Vector *)holds + at;
    Vector *restrict next_motion_tangent = (Vector *)nexts + at;
    ONE_STEP_BY_STATE
  }
}
#endif

/* The state at the next sample, in one step if that is valid, else part by part, and the slopes of the transition. */
static void linearise(const double *state, const double *input, const double *parameters, const double *derived,
                      double *next, double *margin, Slopes *slopes) {
  double hold[HOLD], motion[MOTION], valid = 0;
  linear_prepare(state, input, parameters, derived, next + MOTION, hold, slopes->prepare);
#if HAS_ONE_STEP
  linear_one_step(state, hold, parameters, derived, next, margin, &valid, slopes->one_step);
#endif
  slopes->in_one_step = valid > 0;
  if (slopes->in_one_step) return;
  memcpy(motion, state, sizeof motion);
  for (int part = 0; part < PARTS; ++part) {
    const double number = part;
    linear_move(motion, hold, &number, parameters, derived, next, margin,
                slopes->move + part * LINEAR_MOVE_SLOPES);
    memcpy(motion, next, sizeof motion);
  }
}

/* Tangents (STATES × COLUMNS) of the state at the next sample, from those of the state. */
static void carry(const Slopes *slopes, const double *tangents, double *next) {
  LANE_ARRAY held[HOLD * COLUMNS], between[MOTION * COLUMNS];
  prepare_columns(slopes->prepare, tangents, next + MOTION * COLUMNS, held);
#if HAS_ONE_STEP
  if (slopes->in_one_step) {
    one_step_columns(slopes->one_step, tangents, held, next);
    return;
  }
#endif
  for (int part = 0; part < PARTS; ++part) {
    double *to = (PARTS - part) % 2 ? next : between;
    move_columns(slopes->move + part * LINEAR_MOVE_SLOPES, tangents, held, to);
    tangents = to;
  }
}
