/* Philox4x32-10 (Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011): a block of four
   words of 32 bits for every counter and key, from multiplications alone, so that any can be drawn without those before
   it, and in vector lanes. Comes after driver.h. */

enum { BLOCKS = 16, GROUP = 4 * BLOCKS };

/* The words of a group of BLOCKS blocks, from BLOCKS * group on: word w of block l goes to words[w * BLOCKS + l]. The
   key is `seed`; the counter is the number of the block and, in its higher half, the number of the stream. */
static void draw_words(uint64_t seed, uint64_t stream, uint64_t group, uint32_t *restrict words) {
  for (int l = 0; l < BLOCKS; ++l) {
    uint64_t block = group * BLOCKS + (uint64_t)l;
    uint64_t a = (uint32_t)block, b = block >> 32, c = (uint32_t)stream, d = stream >> 32;
    uint32_t key = (uint32_t)seed, other_key = (uint32_t)(seed >> 32);
    for (int round = 0; round < 10; ++round) {
      uint64_t p = a * 0xD2511F53u, q = c * 0xCD9E8D57u;
      a = (q >> 32) ^ b ^ key;
      b = (uint32_t)q;
      c = (p >> 32) ^ d ^ other_key;
      d = (uint32_t)p;
      key += 0x9E3779B9u;
      other_key += 0xBB67AE85u;
    }
    words[l] = (uint32_t)a;
    words[BLOCKS + l] = (uint32_t)b;
    words[2 * BLOCKS + l] = (uint32_t)c;
    words[3 * BLOCKS + l] = (uint32_t)d;
  }
}
