/* Philox4x32-10 (Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011): a block of four
   words of 32 bits for every counter and key, by multiplications, so that each can be drawn without its predecessors.
   Comes after driver.h. */

enum { WIDTH = 16, BLOCK = 4 }; /* parallel streams in vector lanes, words of a block */

/* Lanes of a register: wider vectors would go through memory piece by piece. */
#if defined(__SSE2__)
#include <immintrin.h>
#endif
#if defined(__AVX512F__)
enum { WIDE = 8 };
#elif defined(__AVX2__)
enum { WIDE = 4 };
#else
enum { WIDE = 2 };
#endif
enum { VECTORS = WIDTH / WIDE };
typedef uint64_t Longs __attribute__((vector_size(WIDE * sizeof(uint64_t))));
typedef uint32_t Words __attribute__((vector_size(WIDE * sizeof(uint32_t))));

/* Words of 32 bits in the lower halves; the upper halves are arbitrary. */
typedef struct {
  uint64_t a, b, c, d;
} Block;

#define FACTOR UINT32_C(0xD2511F53)
#define OTHER_FACTOR UINT32_C(0xCD9E8D57)
enum { ROUNDS = 10 };

static inline Block philox_round(Block block, uint64_t key, uint64_t other_key) {
  const uint64_t p = (uint64_t)(uint32_t)block.a * FACTOR, q = (uint64_t)(uint32_t)block.c * OTHER_FACTOR;
  return (Block){(q >> 32) ^ block.b ^ key, q, (p >> 32) ^ block.d ^ other_key, p};
}

static inline uint64_t round_key(uint64_t key, int round) { return key + (uint64_t)round * 0x9E3779B9u; }
static inline uint64_t other_round_key(uint64_t key, int round) { return key + (uint64_t)round * 0xBB67AE85u; }

static inline Block philox(Block block, uint64_t key, uint64_t other_key) {
  for (int round = 0; round < ROUNDS; ++round)
    block = philox_round(block, round_key(key, round), other_round_key(other_key, round));
  return block;
}

/* Block `number` of a stream. The key is `seed`; the counter is the number of the block and, in its higher half, the
   number of the stream. */
static inline Block block_of(uint64_t seed, uint64_t stream, uint64_t number) {
  return philox((Block){number, number >> 32, stream, stream >> 32}, seed, seed >> 32);
}

/* The keys of all rounds for WIDTH streams. */
typedef struct {
  uint64_t key[ROUNDS][WIDTH], other[ROUNDS][WIDTH];
} Keys;

static inline void set_keys(Keys *keys, int l, uint64_t seed) {
  for (int round = 0; round < ROUNDS; ++round) {
    keys->key[round][l] = round_key(seed, round);
    keys->other[round][l] = other_round_key(seed >> 32, round);
  }
}

/* Products of the lower halves with a word; gcc would expand products of 64 bits into shifts and sums. */
static inline Longs products(Longs words, uint32_t factor) {
#if defined(__AVX512F__)
  return (Longs)_mm512_mul_epu32((__m512i)words, _mm512_set1_epi64(factor));
#elif defined(__AVX2__)
  return (Longs)_mm256_mul_epu32((__m256i)words, _mm256_set1_epi64x(factor));
#elif defined(__SSE2__)
  return (Longs)_mm_mul_epu32((__m128i)words, _mm_set1_epi64x(factor));
#else
  return (words & UINT32_MAX) * factor;
#endif
}

/* Block `number` of WIDTH streams: word w of stream l goes to words[w * WIDTH + l]. */
static __attribute__((noinline)) void draw_words(const Keys *restrict keys, const uint64_t *restrict stream,
                                                 uint64_t number, uint32_t *restrict words) {
  for (int v = 0; v < VECTORS; ++v) {
    Longs b = (Longs){0} + (number >> 32), a = (Longs){0} + number, c, d, key, other;
    memcpy(&c, stream + v * WIDE, sizeof c);
    d = c >> 32;
    for (int round = 0; round < ROUNDS; ++round) {
      memcpy(&key, keys->key[round] + v * WIDE, sizeof key);
      memcpy(&other, keys->other[round] + v * WIDE, sizeof other);
      const Longs p = products(a, FACTOR), q = products(c, OTHER_FACTOR);
      a = (q >> 32) ^ b ^ key;
      b = q;
      c = (p >> 32) ^ d ^ other;
      d = p;
    }
    const Words block[BLOCK] = {__builtin_convertvector(a, Words), __builtin_convertvector(b, Words),
                                __builtin_convertvector(c, Words), __builtin_convertvector(d, Words)};
    for (int w = 0; w < BLOCK; ++w) memcpy(words + w * WIDTH + v * WIDE, block + w, sizeof *block);
  }
}
