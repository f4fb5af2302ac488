/* Philox4x32-10 (Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011): a block of four
   words of 32 bits for every counter and key, from multiplications alone, so that any can be drawn without those before
   it. Comes after driver.h. */

enum { WIDTH = 16, BLOCK = 4 }; /* streams side by side in vector lanes, words of a block */

/* Words of 32 bits, in the lower halves; what the upper ones hold does not matter. */
typedef struct {
  uint64_t a, b, c, d;
} Block;

static inline Block philox(Block block, uint64_t key, uint64_t other_key) {
  for (int round = 0; round < 10; ++round) {
    const uint64_t p = (uint64_t)(uint32_t)block.a * 0xD2511F53u, q = (uint64_t)(uint32_t)block.c * 0xCD9E8D57u;
    block.a = (q >> 32) ^ block.b ^ key;
    block.b = q;
    block.c = (p >> 32) ^ block.d ^ other_key;
    block.d = p;
    key += 0x9E3779B9u;
    other_key += 0xBB67AE85u;
  }
  return block;
}

/* Block `number` of a stream. The key is `seed`; the counter is the number of the block and, in its higher half, the
   number of the stream. */
static inline Block block_of(uint64_t seed, uint64_t stream, uint64_t number) {
  return philox((Block){number, number >> 32, stream, stream >> 32}, seed, seed >> 32);
}

/* The same of WIDTH streams: word w of stream l goes to words[w * WIDTH + l]. */
static __attribute__((noinline)) void draw_words(const uint64_t *restrict seed, const uint64_t *restrict stream,
                                                 uint64_t number, uint32_t *restrict words) {
  for (int l = 0; l < WIDTH; ++l) {
    const Block block = block_of(seed[l], stream[l], number);
    words[l] = (uint32_t)block.a;
    words[WIDTH + l] = (uint32_t)block.b;
    words[2 * WIDTH + l] = (uint32_t)block.c;
    words[3 * WIDTH + l] = (uint32_t)block.d;
  }
}
