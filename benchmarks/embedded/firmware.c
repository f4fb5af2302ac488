/* Runs a single-precision package on a Cortex-M under QEMU: takes a line of inputs a sample from a file of the host
   and gives it the outputs and the clock ticks of every step. To be defined: HEADER, NAME (the package's), SAMPLES,
   FROZEN (whether the parameters are constants). Talks to the host by ARM semihosting. */

#include <stdint.h>
#include <string.h>

#include HEADER

#define JOINED(name, part) name##part
#define JOIN(name, part) JOINED(name, part)
#define OF(part) JOIN(NAME, part)

enum { OPEN = 0x01, WRITE = 0x05, READ = 0x06, LEAVE = 0x18, READING = 1, WRITING = 5, WELL = 0x20026 };

static volatile uint32_t *const clock_registers = (volatile uint32_t *)0xE000E010; /* control, reload, value */
static volatile uint32_t *const fpu_access = (volatile uint32_t *)0xE000ED88;

#define FULL_COUNT 0xFFFFFFu
#define PAINT 0xA5A5A5A5u
#define DEPTH 4096 /* words of stack that are watched */

extern uint32_t stack_top, bss_start, bss_end;
void start(void);

typedef struct {
  OF(_output) output;
  uint32_t ticks;
} result;

static OF(_input) inputs[SAMPLES];
static result results[SAMPLES];
static struct {
  uint32_t empty_call, stack, preparation;
} summary;

static OF(_state) state;
static OF(_output) output;
#if FROZEN
#define PREPARED
#define PARAMETERS
#else
static OF(_parameters) parameters;
static OF(_prepared) prepared;
#define PREPARED , &prepared
#define PARAMETERS , &parameters, &prepared
#endif

static int host(int operation, const void *arguments) {
  register int r0 __asm("r0") = operation;
  register const void *r1 __asm("r1") = arguments;
  __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

static int open_file(const char *name, int mode) {
  const uint32_t arguments[] = {(uint32_t)name, (uint32_t)mode, (uint32_t)strlen(name)};
  return host(OPEN, arguments);
}

static void transfer(int operation, int file, const void *data, uint32_t size) {
  const uint32_t arguments[] = {(uint32_t)file, (uint32_t)data, size};
  host(operation, arguments);
}

static __attribute__((noinline)) void nothing(const OF(_input) *input) { __asm volatile("" : : "r"(input)); }

static __attribute__((noinline)) void step(const OF(_input) *input) {
  OF(_step)(&state, input PREPARED, &output);
}

#if !FROZEN
static __attribute__((noinline)) void prepare(const OF(_input) *input) {
  (void)input;
  OF(_prepare)(&parameters, &prepared);
}
#endif

static uint32_t ticks_of(void (*call)(const OF(_input) *), const OF(_input) *input) {
  uint32_t before = clock_registers[2];
  call(input);
  return (before - clock_registers[2]) & FULL_COUNT;
}

static uint32_t *stack_pointer(void) {
  uint32_t *now;
  __asm volatile("mov %0, sp" : "=r"(now));
  return now;
}

static __attribute__((noinline)) void run(void) {
  uint32_t *deepest, *here = stack_pointer();
  clock_registers[1] = FULL_COUNT;
  clock_registers[2] = 0;
  clock_registers[0] = 5; /* processor clock, no interrupt */
  summary.empty_call = ticks_of(nothing, inputs);
  for (uint32_t *word = here - DEPTH; word < here - 8; ++word) *word = PAINT;
  for (int k = 0; k < SAMPLES; ++k) {
    results[k].ticks = ticks_of(step, inputs + k);
    results[k].output = output;
  }
  for (deepest = here - DEPTH; *deepest == PAINT;) ++deepest;
  summary.stack = (uint32_t)((char *)here - (char *)deepest);
#if !FROZEN
  summary.preparation = ticks_of(prepare, inputs);
#endif
}

void start(void) {
  int file;
  *fpu_access |= 0xFu << 20;
  __asm volatile("dsb\n isb");
  for (uint32_t *word = &bss_start; word < &bss_end; ++word) *word = 0;
  OF(_init)(&state PARAMETERS);
  transfer(READ, open_file("inputs.bin", READING), inputs, sizeof inputs);
  run();
  file = open_file("outputs.bin", WRITING);
  transfer(WRITE, file, &summary, sizeof summary);
  transfer(WRITE, file, results, sizeof results);
  host(LEAVE, (const void *)WELL);
  for (;;) {
  }
}

__attribute__((section(".vectors"), used)) static void *const vectors[] = {&stack_top, (void *)start};
