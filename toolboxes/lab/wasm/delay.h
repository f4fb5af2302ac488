/* Ring buffer for torques that are late by more than a sample, until they are due in the queue of the state. Comes before
   rollout.c. */

enum { LATEST = 100 }; /* samples */

static double late[2 * LATEST];
static int held_back, late_at;

/* Before the first sample the torques of `queue` are on their way. */
static void hold_back_from(const double *queue, int delay) {
  held_back = delay > LATEST ? LATEST - 1 : delay > 1 ? delay - 1 : 0;
  late_at = 0;
  for (int i = 0; i < 2 * held_back; ++i) late[i] = queue[i % 2];
}

static inline void hold_back(double *queue) {
  if (!held_back) return;
  for (int i = 0; i < 2; ++i) {
    const double sent = queue[i];
    queue[i] = late[2 * late_at + i];
    late[2 * late_at + i] = sent;
  }
  late_at = late_at + 1 < held_back ? late_at + 1 : 0;
}

#define AFTER_SAMPLE(next) hold_back((next) + QUEUE)
