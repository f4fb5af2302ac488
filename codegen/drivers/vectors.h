/* Rows of numbers as VECTORS vectors of VECTOR numbers, for the statements of codegen/drivers/tangents.py. Left to
   vectorise loops over such rows, gcc keeps a vector for each factor on the stack; and vectors longer than the
   processor's it takes apart badly. Rows of DIRECTIONS, where that is defined, are whole vectors. */

#if defined(__AVX512F__) && !(defined(DIRECTIONS) && DIRECTIONS % 8)
#define VECTOR 8
#elif defined(__AVX__)
#define VECTOR 4
#else
#define VECTOR 2
#endif

typedef double Vector __attribute__((vector_size(VECTOR * sizeof(double)), may_alias, aligned(sizeof(double))));

/* Vectors of a row that are computed together: each factor is read once for all of them, but the code grows with them. */
#define TOGETHER ((VECTORS) < 6 ? (VECTORS) : (VECTORS) % 4 == 0 ? 4 : (VECTORS) % 3 == 0 ? 3 : (VECTORS) % 2 == 0 ? 2 : 1)
#define EACH_GROUP for (int at = 0; at < VECTORS; at += TOGETHER)

#define WHOLE_VECTORS(count) (((count) + VECTOR - 1) / VECTOR * VECTOR)
#define ZEROS ((Vector){0})
#ifdef __clang__
#define UNROLLED _Pragma("unroll")
#else
#define UNROLLED _Pragma("GCC unroll 16")
#endif
#define EACH_VECTOR UNROLLED for (int v = 0; v < TOGETHER; ++v)
