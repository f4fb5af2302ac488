/* How work is spread over LANES vector lanes. Each loop over the lanes stands in a function of its own (IN_LANES) with
   restrict pointers, or compilers do not see that lanes do not mix. EACH_CALL is for functions by codegen/lanes.py. */

#define LANE_ARRAY __attribute__((aligned(64))) double /* a vector in no more than one cache line */
#define IN_LANES static __attribute__((noinline)) void
#define EACH_LANE for (int l = 0; l < LANES; ++l)
#if PAIRED
#define EACH_CALL for (int l = 0; l < LANES / 2; ++l)
#else
#define EACH_CALL _Pragma("clang loop vectorize(enable) interleave_count(2)") EACH_LANE
#endif
