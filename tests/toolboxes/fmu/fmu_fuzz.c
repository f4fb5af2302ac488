
/* Calls the entry points of the FMU 2 before it in random order with random values, NaN and infinities among them.
   Whatever comes: a value is handed out with a good status only where it is finite, and torques within their limits.
   fmu_fuzz ROUNDS SEED */

static uint64_t bits_now = 1;

static uint64_t draw(void) { /* Marsaglia's xorshift */
  bits_now ^= bits_now << 13, bits_now ^= bits_now >> 7, bits_now ^= bits_now << 17;
  return bits_now * UINT64_C(0x2545F4914F6CDD1D);
}

static double wild(void) {
  static const double special[] = {NAN, INFINITY, -INFINITY, 0.0, -0.0, 1e308, -1e308, 5e-324};
  const uint64_t bits = draw();
  double value;
  switch (bits >> 61) {
    case 0: return special[bits % 8];
    case 1: memcpy(&value, &bits, sizeof value); return value;
    case 2: return (double)(int64_t)bits * 1e-15; /* some thousands */
    default: return (double)(int64_t)bits * 1e-18; /* some units */
  }
}

static void look(fmi2Component c, uint64_t *good, uint64_t *refused) {
  const double smallest = 0.8 / 36 * 200 - 1e-9, largest = 0.8 / 36 * 6000 + 1e-9;
  for (fmi2ValueReference r = 0; r < VARIABLES; r++) {
    double value = 0.0;
    if (fmi2GetReal(c, &r, 1, &value) != STATUS_OK) {
      ++*refused;
      continue;
    }
    ++*good;
    if (!isfinite(value)) abort();
    if (r >= FIRST_OUTPUT && r < FIRST_STATE && strncmp(name[r], "tau_", 4) == 0 && (value < smallest || value > largest))
      abort();
  }
}

int main(int count, char **arguments) {
  uint64_t good = 0, refused = 0;
  void *kept = NULL;
  fmi2Component c = fmi2Instantiate("fuzzed", fmi2CoSimulation, TOKEN, "", NULL, 0, 0);
  if (!c || count < 3) return 2;
  bits_now = 2 * strtoull(arguments[2], NULL, 10) + 1;
  for (long round = atol(arguments[1]); round > 0; --round) {
    fmi2ValueReference r = (fmi2ValueReference)(draw() % (VARIABLES + 2));
    double value = wild(), slope[VARIABLES];
    size_t size = 0;
    switch (draw() % 10) {
      case 0: fmi2ExitInitializationMode(c); break;
      case 1: if (draw() % 8 == 0) fmi2Reset(c); break;
      case 2:
        if (r >= FIRST_PARAMETER && r < FIRST_OUTPUT && isfinite(value)) break; /* the limits stay what they are */
        fmi2SetReal(c, &r, 1, &value);
        break;
      case 3:
        for (r = FIRST_INPUT; r < FIRST_INPUT + INPUTS; r++) value = wild(), fmi2SetReal(c, &r, 1, &value);
        break;
      case 4:
        for (r = FIRST_STATE; r < FIRST_STATE + STATES; r++) value = wild(), fmi2SetReal(c, &r, 1, &value);
        break;
      case 5: fmi2DoStep(c, wild(), draw() % 4 ? (double)(draw() % 5) * SAMPLE_TIME : fabs(value) < 1 ? value : NAN, 1); break;
      case 6: draw() % 2 ? fmi2GetFMUstate(c, &kept) : fmi2SetFMUstate(c, kept); break;
      case 7: fmi2SerializedFMUstateSize(c, kept, &size), fmi2FreeFMUstate(c, &kept); break;
      case 8: fmi2GetDirectionalDerivative(c, &r, 1, &(fmi2ValueReference){FIRST_STATE}, 1, &value, slope); break;
      default: fmi2SetupExperiment(c, 0, 0, value, 0, 0), fmi2GetReal(c, &r, 1, &value);
    }
    look(c, &good, &refused);
  }
  fmi2FreeFMUstate(c, &kept);
  fmi2FreeInstance(c);
  printf("%llu good, %llu refused\n", (unsigned long long)good, (unsigned long long)refused);
  return 0;
}
