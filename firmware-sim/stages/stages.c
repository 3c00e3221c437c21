/* A plugin of qemu (system emulation, Thumb code): instructions by stage, for every image.
 *
 *   -plugin stages.so,map=MAP,out=CSV
 *
 * MAP has lines `ADDRESS STAGE`: the entries of the functions that a stage begins with, as numbers from 1, and `ADDRESS 0` for the
 * function whose entry ends an image. An instruction belongs to the stage of the outermost such function on the call stack, which is
 * followed by watching calls and returns. CSV gets a line an image, and in it a number for each stage from 0, which is none of them.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))
/* What is needed of qemu-plugin.h, which the distribution does not ship. */
typedef uint64_t qemu_plugin_id_t;
typedef struct qemu_info_t qemu_info_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
extern void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t, void (*)(qemu_plugin_id_t, struct qemu_plugin_tb *));
extern void qemu_plugin_register_vcpu_tb_exec_cb(struct qemu_plugin_tb *, void (*)(unsigned, void *), int, void *);
extern void qemu_plugin_register_atexit_cb(qemu_plugin_id_t, void (*)(qemu_plugin_id_t, void *), void *);
extern size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *);
extern struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *, size_t);
extern const void *qemu_plugin_insn_data(const struct qemu_plugin_insn *);
extern size_t qemu_plugin_insn_size(const struct qemu_plugin_insn *);
extern uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *);
EXPORT int qemu_plugin_version = 1;

enum { STAGES = 16, DEPTH = 256, ENTRIES = 256 };

struct block {
  uint32_t start, end;
  uint32_t instructions;
  bool calls;
  int stage; /* that begins here, 0 for none, -1 for the end of an image */
};

static struct { uint32_t address; int stage; } entries[ENTRIES];
static int entry_count;
static struct { uint32_t back; int stage; } stack[DEPTH];
static int depth;
static uint64_t counts[STAGES];
static const struct block *last;
static FILE *out;

static int entry(uint32_t address) {
  for (int i = 0; i < entry_count; i++)
    if (entries[i].address == address) return entries[i].stage == 0 ? -1 : entries[i].stage;
  return 0;
}

static void end_image(void) {
  for (int i = 0; i < STAGES; i++) fprintf(out, i + 1 < STAGES ? "%llu," : "%llu\n", (unsigned long long)counts[i]);
  memset(counts, 0, sizeof counts);
}

static void on_block(unsigned cpu, void *data) {
  const struct block *block = data;
  (void)cpu;
  if (last && last->calls && block->start != last->end) {
    if (depth < DEPTH - 1) {
      int outer = stack[depth].stage;
      depth++;
      stack[depth].back = last->end;
      stack[depth].stage = outer;
    }
  } else {
    /* A return, perhaps of several frames at once. */
    for (int i = depth; i > 0 && i > depth - 4; i--)
      if (stack[i].back == block->start) {
        depth = i - 1;
        break;
      }
  }
  if (block->stage > 0 && stack[depth].stage == 0) stack[depth].stage = block->stage;
  if (block->stage < 0) end_image();
  counts[stack[depth].stage] += block->instructions;
  last = block;
}

static void on_translation(qemu_plugin_id_t id, struct qemu_plugin_tb *tb) {
  struct block *block = calloc(1, sizeof *block);
  (void)id;
  block->instructions = qemu_plugin_tb_n_insns(tb);
  struct qemu_plugin_insn *first = qemu_plugin_tb_get_insn(tb, 0), *end = qemu_plugin_tb_get_insn(tb, block->instructions - 1);
  const uint8_t *code = qemu_plugin_insn_data(end);
  size_t size = qemu_plugin_insn_size(end);
  block->start = qemu_plugin_insn_vaddr(first);
  block->end = qemu_plugin_insn_vaddr(end) + size;
  uint32_t upper = code[0] | code[1] << 8, lower = size == 4 ? code[2] | code[3] << 8 : 0;
  bool branch_with_link = size == 4 && (upper & 0xf800) == 0xf000 && (lower & 0xd000) == 0xd000;
  bool branch_with_link_to_register = size == 2 && (upper & 0xff87) == 0x4780;
  block->calls = branch_with_link || branch_with_link_to_register;
  block->stage = entry(block->start);
  qemu_plugin_register_vcpu_tb_exec_cb(tb, on_block, 0, block);
}

static void at_exit(qemu_plugin_id_t id, void *data) {
  (void)id, (void)data;
  fclose(out);
}

EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const qemu_info_t *info, int argc, char **argv) {
  FILE *map = NULL;
  unsigned address;
  (void)info;
  for (int i = 0; i < argc; i++) {
    if (!strncmp(argv[i], "map=", 4)) map = fopen(argv[i] + 4, "r");
    if (!strncmp(argv[i], "out=", 4)) out = fopen(argv[i] + 4, "w");
  }
  if (!map || !out) return 1;
  while (entry_count < ENTRIES && fscanf(map, "%x %d", &address, &entries[entry_count].stage) == 2)
    entries[entry_count++].address = address;
  fclose(map);
  qemu_plugin_register_vcpu_tb_trans_cb(id, on_translation);
  qemu_plugin_register_atexit_cb(id, at_exit, NULL);
  return 0;
}
