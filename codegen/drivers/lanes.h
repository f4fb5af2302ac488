/* Loops over LANES vector lanes. Each loop needs a function of its own (IN_LANES) with restrict pointers, or compilers do
   not see that lanes do not mix. EACH_CALL is for functions by codegen/source/c_source.py. */

#define LANE_ARRAY __attribute__((aligned(64))) double /* keeps a vector within one cache line */
#define IN_LANES static __attribute__((noinline)) void
#define EACH_OF(count) for (int l = 0; l < (count); ++l)
#define EACH_LANE EACH_OF(LANES)
#if LANES == 1
#define EACH_CALL_OF(count) EACH_OF(count)
#elif PAIRED
#define EACH_CALL_OF(count) EACH_OF((count) / 2)
#elif !defined(__clang__)
#define EACH_CALL_OF(count) EACH_OF(count)
#else
#define EACH_CALL_OF(count) _Pragma("clang loop vectorize(enable) interleave_count(2)") EACH_OF(count)
#endif
#define EACH_CALL EACH_CALL_OF(LANES)
