/* What the benchmarks share: clocks, repeats and what is made of them, an allocator that counts. */
#ifndef BENCH_H
#define BENCH_H

#include <stdint.h>

#include "program.h"

enum { MAX_REPEATS = 40 };

/* 1: seconds() is the processor's time, for machines that others use at the same time. */
static int use_cpu_time;

static inline double seconds(void) {
    struct timespec t;
    clock_gettime(use_cpu_time ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static inline double bench_clock(void *user) {
    (void)user;
    return seconds();
}

static inline void expect(int good, const char *what) {
    if (good) return;
    fprintf(stderr, "%s failed\n", what);
    exit(1);
}

static inline void *room(size_t count, size_t size) {
    void *p = calloc(count + 1, size);
    expect(p != NULL, "malloc");
    return p;
}

/* Uniform in -0.5..0.5, the same in every run. */
static inline dgfem_real noise(void) {
    static uint64_t state = 1;
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (dgfem_real)((double)(state >> 11) * (1.0 / 9007199254740992.0) - 0.5);
}

/* ---- repeats ---- */

static inline int compare_doubles(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static inline double least(const double *values, int count) {
    double best = values[0];
    for (int i = 1; i < count; i++) best = fmin(best, values[i]);
    return best;
}

static inline double most(const double *values, int count) {
    double worst = values[0];
    for (int i = 1; i < count; i++) worst = fmax(worst, values[i]);
    return worst;
}

/* The value that this part of all values does not exceed, linear between neighbours. */
static inline double percentile(const double *values, int count, double part) {
    double *sorted = (double *)room((size_t)count, sizeof *sorted), place = part * (count - 1);
    int below = (int)place, above = below + 1 < count ? below + 1 : below;
    memcpy(sorted, values, (size_t)count * sizeof *values);
    qsort(sorted, (size_t)count, sizeof *sorted, compare_doubles);
    double value = sorted[below] + (place - below) * (sorted[above] - sorted[below]);
    free(sorted);
    return value;
}

static inline double median(const double *values, int count) { return percentile(values, count, 0.5); }

static inline double mean(const double *values, int count) {
    double sum = 0;
    for (int i = 0; i < count; i++) sum += values[i];
    return sum / count;
}

/* ---- memory ---- */

typedef struct counted {
    double live, peak; /* bytes */
    long calls;        /* that ask for memory */
} counted;

/* Counts what is allocated, each block's size in a header before it. */
static inline void *count_bytes(void *user, void *pointer, size_t size) {
    counted *c = (counted *)user;
    size_t *block = pointer ? (size_t *)pointer - 2 : NULL;
    if (block) c->live -= (double)*block;
    if (size == 0) {
        free(block);
        return NULL;
    }
    block = (size_t *)realloc(block, size + 2 * sizeof *block);
    expect(block != NULL, "malloc");
    *block = size;
    c->calls++;
    c->live += (double)size;
    c->peak = fmax(c->peak, c->live);
    return block + 2;
}

/* Log on stderr, the clock above, and where `c` is not NULL an allocator that counts. */
static inline dgfem_hooks bench_hooks(counted *c) {
    dgfem_hooks hooks = program_hooks();
    hooks.clock = bench_clock;
    if (c) hooks.reallocate = count_bytes;
    hooks.reallocate_user = c;
    return hooks;
}

#endif
