/* Throws bytes at a controller package in double precision: inputs, states and some parameters, NaN and infinities among
   them. Whatever comes, a step must leave a finite output and torques within the limits of its parameters.
   With libFuzzer, or alone: fuzz ROUNDS SEED. */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "controller.h"

enum { STATES = offsetof(controller_state, output) / sizeof(double),
       INPUTS = sizeof(controller_input) / sizeof(double),
       PARAMETERS = sizeof(controller_parameters) / sizeof(double),
       OUTPUTS = sizeof(controller_output) / sizeof(double) };

static uint64_t accepted, refused;

static double wild(uint64_t bits) {
  static const double special[] = {NAN, INFINITY, -INFINITY, 0.0, -0.0, 1e308, -1e308, 5e-324};
  double value;
  switch (bits & 3) {
    case 0: return (double)(int64_t)bits * 1e-18;              /* some units */
    case 1: return (double)(int64_t)bits * 1e-15;              /* some thousands */
    case 2: memcpy(&value, &bits, sizeof value); return value; /* anything at all */
    default: return (bits >> 2) % 5 == 0 ? special[(bits >> 8) % 8] : (double)(int64_t)(bits >> 40) * 1e-6;
  }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  controller_state state, before;
  controller_parameters parameters;
  controller_prepared prepared, kept;
  controller_input input;
  controller_output output;
  double words[STATES + INPUTS], out[OUTPUTS];
  uint64_t bits;
  int rounds = 0;

  controller_init(&state, &parameters, &prepared);
  kept = prepared;
  for (; size >= (STATES + INPUTS) * sizeof bits && rounds < 8; ++rounds) {
    for (int k = 0; k < STATES + INPUTS; ++k, data += sizeof bits, size -= sizeof bits) {
      memcpy(&bits, data, sizeof bits);
      words[k] = wild(bits);
    }
    if (data[-1] % 4 == 0) memcpy(&state, words, STATES * sizeof *words);
    memcpy(&input, words + STATES, sizeof input);
    if (data[-2] % 16 == 0) {
      double spoiled = words[0];
      memcpy((double *)(void *)&parameters + data[-3] % PARAMETERS, &spoiled, sizeof spoiled);
      int valid = controller_prepare(&parameters, &prepared) == CONTROLLER_OK;
      if (valid != (controller_invalid_parameter(&parameters) == 0) || (valid && !isfinite(spoiled))) abort();
      if (!valid && memcmp(&prepared, &kept, sizeof kept) != 0) abort();
      prepared = kept; /* limits are judged below with the defaults */
    }
    before = state;
    controller_status status = controller_step(&state, &input, &prepared, &output);
    memcpy(out, &output, sizeof out);
    for (int k = 0; k < OUTPUTS; ++k)
      if (!isfinite(out[k])) abort();
    if (status == CONTROLLER_OK) ++accepted;
    else ++refused;
    if (status != CONTROLLER_OK && memcmp(&before, &state, STATES * sizeof(double)) != 0) abort();
    controller_defaults(&parameters);
    double smallest = 0.8 / 36 * 200, largest = 0.8 / 36 * 6000, slip = 1e-9;
    if (output.tau_1 < smallest - slip || output.tau_1 > largest + slip) abort();
    if (output.tau_2 < smallest - slip || output.tau_2 > largest + slip) abort();
  }
  return 0;
}

#ifndef LIBFUZZER
int main(int count, char **arguments) {
  uint64_t x = count > 2 ? strtoull(arguments[2], 0, 10) * 2 + 1 : 1;
  uint64_t words[8 * (STATES + INPUTS)];
  for (long round = count > 1 ? atol(arguments[1]) : 1000; round > 0; --round) {
    for (size_t k = 0; k < sizeof words / sizeof *words; ++k) {
      x ^= x << 13, x ^= x >> 7, x ^= x << 17; /* Marsaglia's xorshift */
      words[k] = x * UINT64_C(0x2545F4914F6CDD1D);
    }
    LLVMFuzzerTestOneInput((const uint8_t *)words, sizeof words);
  }
  printf("%llu accepted, %llu refused\n", (unsigned long long)accepted, (unsigned long long)refused);
  return accepted && refused ? 0 : 1;
}
#endif
