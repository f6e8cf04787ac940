/*
 * Runs the executor of an exported table:
 *     check FILE          every row of a file of vectors
 *     fuzz CALLS SEED     any arguments; the answer must be one that the table has
 *     time CALLS          prints the nanoseconds of a decision: the mean of all readings, and the slowest reading's
 * Exit code 1 and a line on standard error where an answer is wrong.
 */
#include "squeezetree_table.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static int check(const char *path)
{
    FILE *file = fopen(path, "r");
    long rows = 0;
    int32_t v[7];

    if (file == NULL || fscanf(file, "%*[^\n]") != 0) {
        fprintf(stderr, "%s cannot be read\n", path);
        return 1;
    }
    while (fscanf(file, "%" SCNd32 ",%" SCNd32 ",%" SCNd32 ",%" SCNd32 ",%" SCNd32 ",%" SCNd32 ",%" SCNd32, &v[0],
                  &v[1], &v[2], &v[3], &v[4], &v[5], &v[6]) == 7) {
        squeezetree_decision made = squeezetree_decide(v[0], v[1], v[2]);
        int released = made.release_x_um == v[5] && made.release_y_um == v[6];

        rows++;
        if (made.outcome != v[3] || made.index != v[4] || !released) {
            fprintf(stderr, "row %ld: outcome %" PRId32 ", index %" PRId32 "\n", rows, made.outcome, made.index);
            return 1;
        }
    }
    if (!feof(file)) {
        fprintf(stderr, "row %ld is not seven numbers\n", rows + 1);
        return 1;
    }
    fclose(file);
    printf("%ld\n", rows);
    return 0;
}

static uint64_t state;

/* xorshift64 (Marsaglia 2003). */
static uint32_t drawn(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (uint32_t)(state >> 32);
}

/* Of eight numbers seven are within 0..most or just beside, one is any. */
static int32_t argument(int32_t most)
{
    uint32_t bits = drawn();
    int32_t any;

    if (bits & 7) {
        return (int32_t)(drawn() % ((uint32_t)most + 3)) - 1;
    }
    bits = drawn();
    memcpy(&any, &bits, sizeof any);
    return any;
}

static int possible(const squeezetree_decision *made)
{
    switch (made->outcome) {
    case SQUEEZETREE_NODE:
        return made->index > 0 && made->index < SQUEEZETREE_NODES;
    case SQUEEZETREE_LEAF:
    case SQUEEZETREE_UNRESOLVED:
        return made->index >= 0 && made->index < SQUEEZETREE_LEAVES &&
               squeezetree_leaves[made->index].resolved == (made->outcome == SQUEEZETREE_LEAF);
    case SQUEEZETREE_REJECT:
    case SQUEEZETREE_FAULT:
        return made->index == -1;
    default:
        return 0;
    }
}

static int fuzz(long calls, uint64_t seed)
{
    long k, met[5] = {0, 0, 0, 0, 0};

    state = seed * UINT64_C(0x9E3779B97F4A7C15) + 1;
    for (k = 0; k < calls; k++) {
        int32_t node = argument(SQUEEZETREE_NODES), width_um = argument(90000), flag = argument(3);
        squeezetree_decision made = squeezetree_decide(node, width_um, flag);
        int wanted = node >= 0 && node < SQUEEZETREE_NODES && (flag == 2 || flag == 3);

        if (!possible(&made) || wanted != (made.outcome != SQUEEZETREE_FAULT)) {
            fprintf(stderr, "%" PRId32 ", %" PRId32 ", %" PRId32 ": %" PRId32 "\n", node, width_um, flag, made.outcome);
            return 1;
        }
        met[made.outcome]++;
    }
    printf("%ld %ld %ld %ld %ld\n", met[0], met[1], met[2], met[3], met[4]);
    return 0;
}

static int times(long calls)
{
    static volatile int32_t sink;
    double sum = 0.0, worst = 0.0;
    volatile int32_t node, width_um, flag;

    for (node = 0; node < SQUEEZETREE_NODES; node++) {
        for (width_um = 0; width_um < 90000; width_um += 353) {
            for (flag = 2; flag <= 3; flag++) {
                clock_t begun = clock();
                double each;
                long k;

                for (k = 0; k < calls; k++) {
                    sink = squeezetree_decide(node, width_um, flag).index;
                }
                each = 1e9 * (double)(clock() - begun) / CLOCKS_PER_SEC / (double)calls;
                sum += each;
                worst = each > worst ? each : worst;
            }
        }
    }
    (void)sink;
    printf("%.2f %.2f\n", sum / (512.0 * SQUEEZETREE_NODES), worst);
    return 0;
}

int main(int count, char **words)
{
    if (count == 3 && strcmp(words[1], "check") == 0) {
        return check(words[2]);
    }
    if (count == 4 && strcmp(words[1], "fuzz") == 0) {
        return fuzz(atol(words[2]), (uint64_t)atol(words[3]));
    }
    if (count == 3 && strcmp(words[1], "time") == 0) {
        return times(atol(words[2]));
    }
    fputs("check FILE, fuzz CALLS SEED or time CALLS\n", stderr);
    return 2;
}
