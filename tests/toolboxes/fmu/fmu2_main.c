
/* Uses two instances of the FMU before it in every way, wrong ones too. */

#define EXPECT(condition)                            \
  do {                                               \
    if (!(condition)) {                              \
      fprintf(stderr, "not so: %s\n", #condition);   \
      exit(1);                                       \
    }                                                \
  } while (0)

int main(void) {
  const fmi2ValueReference force = FIRST_INPUT, x = FIRST_STATE, beyond = VARIABLES, slope = FIRST_DERIVATIVE;
  double value = 2.0, before, after;
  fmi2FMUstate kept = NULL, again = NULL;
  size_t size = 0;
  EXPECT(!fmi2Instantiate("a", fmi2CoSimulation, "another token", "", NULL, 0, 0));
  fmi2Component a = fmi2Instantiate("a", fmi2CoSimulation, TOKEN, "", NULL, 0, 0);
  fmi2Component b = fmi2Instantiate(NULL, fmi2CoSimulation, TOKEN, "", NULL, 0, 0);
  EXPECT(a && b);
  EXPECT(fmi2SetupExperiment(a, 0, 0, 0, 0, 0) == STATUS_OK && fmi2EnterInitializationMode(a) == STATUS_OK);
  EXPECT(fmi2SetReal(a, &x, 1, &value) == STATUS_ERROR);
  EXPECT(fmi2ExitInitializationMode(a) == STATUS_OK && fmi2ExitInitializationMode(b) == STATUS_OK);
  EXPECT(fmi2SetReal(a, &force, 1, &value) == STATUS_OK);
  value = (double)NAN;
  EXPECT(fmi2SetReal(a, &force, 1, &value) == STATUS_DISCARD);
  EXPECT(fmi2GetReal(a, &beyond, 1, &value) == STATUS_ERROR && fmi2SetReal(a, &beyond, 1, &value) == STATUS_ERROR);
  EXPECT(fmi2DoStep(a, 0.0, 10 * SAMPLE_TIME, 1) == STATUS_OK);
  EXPECT(fmi2DoStep(a, 0.0, 0.3 * SAMPLE_TIME, 1) == STATUS_ERROR);
  EXPECT(fmi2GetFMUstate(a, &kept) == STATUS_OK && fmi2SerializedFMUstateSize(a, kept, &size) == STATUS_OK);
  char *bytes = malloc(size);
  EXPECT(bytes && fmi2SerializeFMUstate(a, kept, bytes, size - 1) == STATUS_ERROR);
  EXPECT(fmi2SerializeFMUstate(a, kept, bytes, size) == STATUS_OK);
  EXPECT(fmi2DeSerializeFMUstate(b, bytes, size, &again) == STATUS_OK && fmi2SetFMUstate(b, again) == STATUS_OK);
  EXPECT(fmi2GetReal(a, &x, 1, &before) == STATUS_OK && fmi2GetReal(b, &x, 1, &after) == STATUS_OK);
  EXPECT(before == after && before != start_value[FIRST_STATE]);
  bytes[0] ^= 1;
  EXPECT(fmi2DeSerializeFMUstate(b, bytes, size, &again) == STATUS_ERROR);
  free(bytes);
  fmi2FreeFMUstate(a, &kept);
  fmi2FreeFMUstate(b, &again);
  EXPECT(!kept && !again && fmi2FreeFMUstate(a, &kept) == STATUS_OK && fmi2SetFMUstate(a, kept) == STATUS_ERROR);
  value = 1.0;
  EXPECT(fmi2GetDirectionalDerivative(a, &slope, 1, &x, 1, &value, &after) ==
         (HAS_DERIVATIVES ? STATUS_OK : STATUS_ERROR));
  EXPECT(fmi2Reset(a) == STATUS_OK && fmi2GetReal(a, &x, 1, &after) == STATUS_OK);
  EXPECT(after == start_value[FIRST_STATE]);
  EXPECT(fmi2GetInteger(a, &x, 1, &(int){0}) == STATUS_ERROR && fmi2Terminate(a) == STATUS_OK);
  fmi2FreeInstance(a);
  fmi2FreeInstance(b);
  fmi2FreeInstance(NULL);
  return 0;
}
