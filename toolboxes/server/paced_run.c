/* Runs stepping.c in real time, or in lockstep with the answers of a client, and exchanges datagrams with that client.
   Comes after driver.h. The layout of datagrams is that of the structures below; their numbers are little-endian, as on
   every processor for which this is built. */

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stddef.h>
#include <sys/socket.h>
#include <time.h>
#if defined(__linux__)
#include <sys/prctl.h>
#endif

#define COMMAND_MAGIC 0x31435744u     /* "DWC1" */
#define MEASUREMENT_MAGIC 0x314d5744u /* "DWM1" */

enum { HAS_TORQUES = 1, STARTS = 2, HELLO = 4 };                    /* flags of a command */
enum { IS_RUNNING = 1, IS_SAFE = 2, MAY_WRITE = 4, HAS_ENDED = 8 }; /* flags of a measurement */
enum { MOST_A_SAMPLE = 64 };                                        /* datagrams read in one sample */
enum { LARGEST = 64 };                                              /* signals of a measurement, at most */

typedef struct {
  uint32_t magic, flags;
  uint64_t sequence; /* number of the answered sample */
  double torques[2];
} Command;

typedef struct {
  uint32_t magic, flags;
  uint64_t sequence; /* number of the sample */
  double signals[LARGEST];
} Measurement;

typedef int64_t Step(const void *runs, int64_t first, int64_t last, int64_t samples, double *row);
typedef void Look(const void *runs, int64_t first, int64_t last);

/* Data of `serve`. Another thread reads the counts and sets the volatile members, a word at a time. */
typedef struct {
  /* the run */
  Step *step;
  Look *look;
  const void *runs;
  const double **line;       /* the run's pointer to its exogenous signals */
  double *lines;             /* (2, exogenous) signals of a sample and the next */
  const double *table;       /* (samples + 1, exogenous) */
  volatile double *added;    /* (exogenous,) added to those of the table */
  double *commands;          /* (2,) torques in N m */
  const double *observation; /* (signals,) */
  const int64_t *outcome, *done;
  double *rows; /* (samples, columns) */
  int64_t exogenous, columns, signals;
  /* timing and commands */
  int64_t socket, period, lockstep, may_write; /* period in ns */
  int64_t watchdog, release;                   /* samples without a command until torques are safe; silence in ns until
                                                  another client is admitted */
  double safe[2], largest[2];                  /* torques in N m */
  double brake[2], least[2], most[2];          /* added to the safe torques per m/s; limits of the sum */
  int64_t position, speed, reference[3];       /* places in the observation; of the reference in the exogenous signals */
  volatile double share[2];                    /* effective share of each motor's command */
  volatile double other[2];                    /* torques from another source than datagrams */
  volatile int64_t other_count, start, quit;   /* number of those; requests to start and to end the run */
  /* status and counts */
  volatile int64_t running, is_safe, silences, connected;
  volatile int64_t by_datagram, held; /* whether the command in force is a datagram's; whether the reference is held */
  volatile double held_at;            /* where, in m */
  volatile int64_t ticks, missed, latest; /* ns */
  volatile int64_t accepted, refused, not_allowed;
  int64_t bins, oldest;
  const int64_t *edges; /* (bins - 1,) ns, ascending */
  volatile int64_t *lateness, *ages; /* (bins,) ticks; (oldest + 1,) samples by the age of the command in force */
} Served;

enum { NEVER = -(1 << 30) };

/* Private data of `serve`: sample numbers, except for `heard` in ns. */
typedef struct {
  Served *served;
  int64_t answered;        /* the sample of the last answer */
  int64_t measured, fresh; /* the sample from which the present command was computed, and that of its arrival */
  int64_t by_datagram;     /* whether it came by datagram */
  int64_t other_seen, heard;
} Link;

static int64_t now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static void sleep_until(int64_t instant) {
  for (int64_t left = instant - now_ns(); left > 0; left = instant - now_ns()) {
    const struct timespec t = {(time_t)(left / 1000000000), (long)(left % 1000000000)};
    nanosleep(&t, NULL);
  }
}

static void let_go(Link *link) {
  const struct sockaddr none = {.sa_family = AF_UNSPEC};
  connect((int)link->served->socket, &none, sizeof none);
  link->served->connected = link->served->by_datagram = link->by_datagram = 0;
}

static int within(const double *torques, const double *largest) {
  return fabs(torques[0]) <= largest[0] && fabs(torques[1]) <= largest[1];
}

/* Whether a datagram has the layout, answers a sample that has been sent, none earlier than the last answered one, and
   has torques within their limits. */
static int is_valid(const Link *link, const Command *c, ssize_t size) {
  if (size != sizeof *c || c->magic != COMMAND_MAGIC || c->flags & ~(uint32_t)(HAS_TORQUES | STARTS | HELLO)) return 0;
  if (c->flags & HELLO) return c->flags == HELLO;
  if (c->sequence > (uint64_t)*link->served->done || (int64_t)c->sequence < link->answered) return 0;
  return !(c->flags & HAS_TORQUES) || (all_finite(c->torques, 2) && within(c->torques, link->served->largest));
}

static void take(Link *link, const double *torques, int64_t measured, int64_t by_datagram) {
  Served *s = link->served;
  for (int i = 0; i < 2; ++i) s->commands[i] = torques[i];
  link->measured = measured;
  link->fresh = *s->done;
  link->by_datagram = s->by_datagram = by_datagram;
  ++s->accepted;
}

static void take_answer(Link *link, const Command *c) {
  Served *s = link->served;
  link->answered = (int64_t)c->sequence;
  if (c->flags && !s->may_write) {
    ++s->not_allowed;
    return;
  }
  if (c->flags & STARTS) s->start = 1;
  if (c->flags & HAS_TORQUES) take(link, c->torques, link->answered, 1);
}

/* Reads the received datagrams, MOST_A_SAMPLE at most. The first sender of a valid one becomes the client: from then on
   the system accepts its datagrams only, until it falls silent. */
static void receive(Link *link) {
  Served *s = link->served;
  union {
    Command command;
    char bytes[sizeof(Command) + 1]; /* detects datagrams that are too long */
  } room;
  for (int i = 0; i < MOST_A_SAMPLE; ++i) {
    struct sockaddr_storage sender;
    socklen_t length = sizeof sender;
    const ssize_t size = recvfrom((int)s->socket, &room, sizeof room, 0, (struct sockaddr *)&sender, &length);
    if (size < 0 && errno != ECONNREFUSED) break; /* refused: an earlier datagram did not arrive */
    if (size < 0) continue;
    if (!is_valid(link, &room.command, size)) {
      ++s->refused;
      continue;
    }
    if (!s->connected) s->connected = !connect((int)s->socket, (struct sockaddr *)&sender, length);
    link->heard = now_ns();
    if (room.command.flags != HELLO) take_answer(link, &room.command);
  }
  if (s->connected && now_ns() - link->heard > s->release) let_go(link);
}

/* Torques from another source apply while none come by datagram. */
static void take_other(Link *link) {
  Served *s = link->served;
  const int64_t count = s->other_count;
  if (count == link->other_seen) return;
  link->other_seen = count;
  const double torques[2] = {s->other[0], s->other[1]};
  if (link->by_datagram && *s->done - link->fresh <= s->watchdog) ++s->refused;
  else take(link, torques, *s->done, 0);
}

static void send_measurement(const Served *s, uint32_t flags) {
  if (!s->connected) return;
  if (s->is_safe) flags |= IS_SAFE;
  if (s->may_write) flags |= MAY_WRITE;
  const size_t size = (size_t)s->signals * sizeof(double);
  Measurement m = {MEASUREMENT_MAGIC, flags, (uint64_t)*s->done, {0}};
  memcpy(m.signals, s->observation, size);
  (void)!send((int)s->socket, &m, offsetof(Measurement, signals) + size, 0); /* a client that has gone falls silent */
}

/* Observes the next sample, with the present added signals. */
static void look_now(const Served *s) {
  const double *from = s->table + *s->done * s->exogenous;
  for (int64_t i = 0; i < 2 * s->exogenous; ++i) s->lines[i] = from[i] + s->added[i % s->exogenous];
  if (s->held)
    for (int64_t i = 0; i < 6; ++i) s->lines[s->reference[i % 3] + i / 3 * s->exogenous] = i % 3 ? 0 : s->held_at;
  *s->line = s->lines;
  s->look(s->runs, 0, 1);
}

static void count_lateness(Served *s, int64_t late) {
  int64_t bin = 0;
  while (bin < s->bins - 1 && late > s->edges[bin]) ++bin;
  ++s->lateness[bin];
  ++s->ticks;
  if (late > s->latest) s->latest = late;
  if (late > s->period) ++s->missed;
}

/* The safe torque of a winch: a constant, and a brake by the measured speed if there is a reading. */
static double safe_torque(const Served *s, int winch) {
  const double v = s->observation[s->speed], torque = s->safe[winch] + s->brake[winch] * v;
  if (s->brake[winch] == 0 || !isfinite(v)) return s->safe[winch];
  return fmin(fmax(torque, s->least[winch]), s->most[winch]);
}

/* Steps the run by a sample, with safe torques if the last command is too old; the reference is then held where the
   vehicle is. Before the first command of a run nobody has fallen silent. */
static void move(Link *link) {
  Served *s = link->served;
  const int64_t sample = *s->done, age = sample - link->measured;
  const int64_t silent = sample - link->fresh > s->watchdog;
  if (silent && link->fresh != NEVER) {
    if (!s->is_safe) ++s->silences;
    const double x = s->observation[s->position];
    s->held_at = isfinite(x) ? x : s->lines[s->reference[0]];
    s->held = 1;
    s->by_datagram = 0;
  }
  if (!silent) ++s->ages[age < s->oldest ? age : s->oldest];
  s->is_safe = silent;
  const double given[2] = {s->commands[0], s->commands[1]};
  for (int i = 0; i < 2; ++i) s->commands[i] = (silent ? safe_torque(s, i) : given[i]) * s->share[i];
  s->step(s->runs, 0, 1, 1, s->rows + sample * s->columns);
  for (int i = 0; i < 2; ++i) s->commands[i] = given[i];
}

static void wait_for_datagram(const Served *s) {
  struct pollfd ready = {(int)s->socket, POLLIN, 0};
  poll(&ready, 1, 10); /* ms, to check for `quit` in between */
}

/* Before the run: shows its first sample until a client, or another thread, starts it. */
static void await_start(Link *link) {
  Served *s = link->served;
  while (!s->start && !s->quit) {
    look_now(s);
    send_measurement(s, 0);
    if (s->lockstep) wait_for_datagram(s);
    else sleep_until(now_ns() + s->period);
    receive(link);
    take_other(link);
    if (!s->connected && link->by_datagram) link->fresh = NEVER;
  }
}

/* Runs one sample as soon as the client has answered it. */
static void in_lockstep(Link *link) {
  Served *s = link->served;
  look_now(s);
  for (link->answered = *s->done - 1; link->answered < *s->done && !s->quit; receive(link)) {
    send_measurement(s, IS_RUNNING);
    wait_for_datagram(s);
  }
  if (!s->quit) move(link);
}

/* Runs one sample at its time, with the last received command, while the client computes the next. */
static void on_time(Link *link, int64_t deadline, int64_t *before) {
  Served *s = link->served;
  const int64_t soonest = *before + s->period / 4; /* lets a client follow while missed samples are made up for */
  sleep_until(deadline > soonest ? deadline : soonest);
  *before = now_ns();
  count_lateness(s, *before - deadline);
  receive(link);
  take_other(link);
  look_now(s);
  send_measurement(s, IS_RUNNING);
  move(link);
}

/* Serves a run from its first sample until it has ended, or `quit` is set. */
EXPORT void serve(Served *s) {
  Link link = {s, 0, 0, NEVER, 0, 0, now_ns()};
#if defined(__linux__)
  prctl(PR_SET_TIMERSLACK, 1000ul); /* ns, of this thread; by default it wakes up to 50 us late */
#endif
  await_start(&link);
  int64_t before = 0;
  const int64_t began = now_ns();
  s->running = 1;
  while (!s->quit && *s->outcome == RUNNING) {
    if (s->lockstep) in_lockstep(&link);
    else on_time(&link, began + *s->done * s->period, &before);
  }
  s->running = 0;
  send_measurement(s, HAS_ENDED);
  let_go(&link); /* so that any client can begin the next run */
}
