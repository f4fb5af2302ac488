
/* Uses two instances of the FMU before it in every way, wrong ones too. */

#define EXPECT(condition)                            \
  do {                                               \
    if (!(condition)) {                              \
      fprintf(stderr, "not so: %s\n", #condition);   \
      exit(1);                                       \
    }                                                \
  } while (0)

int main(void) {
  const fmi3ValueReference force = FIRST_INPUT, x = FIRST_STATE, beyond = VARIABLES, slope = FIRST_DERIVATIVE;
  double value = 2.0, before, after;
  fmi3FMUState kept = NULL, again = NULL;
  size_t size = 0;
  bool flag[3];
  double time;
  EXPECT(!fmi3InstantiateCoSimulation("a", "another token", "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL));
  fmi3Instance a = fmi3InstantiateCoSimulation("a", TOKEN, "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
  fmi3Instance b = fmi3InstantiateCoSimulation(NULL, TOKEN, "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
  EXPECT(a && b);
  EXPECT(fmi3EnterInitializationMode(a, false, 0, 0, false, 0) == STATUS_OK);
  EXPECT(fmi3SetFloat64(a, &x, 1, &value, 1) == STATUS_ERROR);
  EXPECT(fmi3ExitInitializationMode(a) == STATUS_OK && fmi3ExitInitializationMode(b) == STATUS_OK);
  EXPECT(fmi3SetFloat64(a, &force, 1, &value, 1) == STATUS_OK);
  value = (double)NAN;
  EXPECT(fmi3SetFloat64(a, &force, 1, &value, 1) == STATUS_DISCARD);
  EXPECT(fmi3GetFloat64(a, &beyond, 1, &value, 1) == STATUS_ERROR);
  EXPECT(fmi3SetFloat64(a, &beyond, 1, &value, 1) == STATUS_ERROR);
  EXPECT(fmi3SetFloat64(a, &force, 1, &value, 2) == STATUS_ERROR);
  EXPECT(fmi3DoStep(a, 0.0, 10 * SAMPLE_TIME, true, &flag[0], &flag[1], &flag[2], &time) == STATUS_OK);
  EXPECT(fmi3DoStep(a, 0.0, 0.3 * SAMPLE_TIME, true, &flag[0], &flag[1], &flag[2], &time) == STATUS_ERROR);
  EXPECT(fmi3GetFMUState(a, &kept) == STATUS_OK && fmi3SerializedFMUStateSize(a, kept, &size) == STATUS_OK);
  fmi3Byte *bytes = malloc(size);
  EXPECT(bytes && fmi3SerializeFMUState(a, kept, bytes, size - 1) == STATUS_ERROR);
  EXPECT(fmi3SerializeFMUState(a, kept, bytes, size) == STATUS_OK);
  EXPECT(fmi3DeserializeFMUState(b, bytes, size, &again) == STATUS_OK && fmi3SetFMUState(b, again) == STATUS_OK);
  EXPECT(fmi3GetFloat64(a, &x, 1, &before, 1) == STATUS_OK && fmi3GetFloat64(b, &x, 1, &after, 1) == STATUS_OK);
  EXPECT(before == after && before != start_value[FIRST_STATE]);
  bytes[0] ^= 1;
  EXPECT(fmi3DeserializeFMUState(b, bytes, size, &again) == STATUS_ERROR);
  free(bytes);
  fmi3FreeFMUState(a, &kept);
  fmi3FreeFMUState(b, &again);
  EXPECT(!kept && !again && fmi3FreeFMUState(a, &kept) == STATUS_OK && fmi3SetFMUState(a, kept) == STATUS_ERROR);
  value = 1.0;
  EXPECT(fmi3GetDirectionalDerivative(a, &slope, 1, &x, 1, &value, 1, &after, 1) ==
         (HAS_DERIVATIVES ? STATUS_OK : STATUS_ERROR));
  EXPECT(fmi3Reset(a) == STATUS_OK && fmi3GetFloat64(a, &x, 1, &after, 1) == STATUS_OK);
  EXPECT(after == start_value[FIRST_STATE]);
  EXPECT(fmi3GetInt32(a, &x, 1, &(int32_t){0}, 1) == STATUS_ERROR && fmi3Terminate(a) == STATUS_OK);
  fmi3FreeInstance(a);
  fmi3FreeInstance(b);
  fmi3FreeInstance(NULL);
  return 0;
}
