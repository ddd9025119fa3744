/* Shared by the tests: include it after dgfem.h. Comparisons fail on NaN, random numbers come from printed seeds,
   every allocation can be counted and made to fail, and the log can be read. */
#ifndef CHECK_H
#define CHECK_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* Distance of 1 to the next number of the precision under test: tolerances are multiples of it. */
#define CHECK_EPSILON (DGFEM_REAL_IS_FLOAT ? 1.1920928955078125e-7 : 2.220446049250313e-16)

/* Tests run longer campaigns where DGFEM_LONG is set in the environment. */
static inline int check_long(void) { return getenv("DGFEM_LONG") != NULL; }

static inline dgfem_vec3 vec3(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = (dgfem_real)x, v.y = (dgfem_real)y, v.z = (dgfem_real)z;
    return v;
}

static inline double check_distance(dgfem_vec3 a, dgfem_vec3 b) {
    double x = (double)a.x - (double)b.x, y = (double)a.y - (double)b.y, z = (double)a.z - (double)b.z;
    return sqrt(x * x + y * y + z * z);
}

/* ---- comparisons ---- */

static inline void check_near_at(double actual, double expected, double tolerance, const char *text, const char *file,
                                 int line) {
    if (fabs(actual - expected) <= tolerance) return; /* false for NaN */
    print_error("%s: %.17g is not %.17g within %g (off by %g)\n", text, actual, expected, tolerance,
                fabs(actual - expected));
    _fail(file, line);
}

/* |actual - expected| <= tolerance. */
#define check_near(actual, expected, tolerance)                                                                        \
    check_near_at((double)(actual), (double)(expected), (double)(tolerance), #actual, __FILE__, __LINE__)

/* Each component of two dgfem_vec3. */
#define check_near3(actual, expected, tolerance)                                                                       \
    check_near3_at((actual), (expected), (double)(tolerance), #actual, __FILE__, __LINE__)

static inline void check_near3_at(dgfem_vec3 actual, dgfem_vec3 expected, double tolerance, const char *text,
                                  const char *file, int line) {
    check_near_at((double)actual.x, (double)expected.x, tolerance, text, file, line);
    check_near_at((double)actual.y, (double)expected.y, tolerance, text, file, line);
    check_near_at((double)actual.z, (double)expected.z, tolerance, text, file, line);
}

/* The status of a call, by name. */
#define check_status(call, expected) check_status_at((call), (expected), #call, __FILE__, __LINE__)

static inline void check_status_at(dgfem_status actual, dgfem_status expected, const char *text, const char *file,
                                   int line) {
    if (actual == expected) return;
    print_error("%s: \"%s\" is not \"%s\"\n", text, dgfem_status_text(actual), dgfem_status_text(expected));
    _fail(file, line);
}

/* ---- random numbers (splitmix64) ---- */

typedef struct check_random {
    uint64_t state;
} check_random;

static inline check_random check_random_seeded(uint64_t seed) {
    check_random random;
    random.state = seed;
    print_message("seed %llu\n", (unsigned long long)seed);
    return random;
}

static inline uint64_t check_random_bits(check_random *random) {
    uint64_t z = random->state += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

/* lower <= result < upper */
static inline double check_random_real(check_random *random, double lower, double upper) {
    return lower + (upper - lower) * (double)(check_random_bits(random) >> 11) * 0x1p-53;
}

/* 0 <= result < count */
static inline int check_random_int(check_random *random, int count) {
    return (int)(check_random_bits(random) % (uint64_t)count);
}

static inline dgfem_vec3 check_random_vec3(check_random *random, double lower, double upper) {
    dgfem_vec3 v;
    v.x = (dgfem_real)check_random_real(random, lower, upper);
    v.y = (dgfem_real)check_random_real(random, lower, upper);
    v.z = (dgfem_real)check_random_real(random, lower, upper);
    return v;
}

/* ---- hooks that count, fail and listen ---- */

typedef struct check_host {
    long calls;     /* allocations and reallocations asked for so far */
    long fail_from; /* this call and all later ones return NULL; 0: none */
    long live;      /* blocks not yet freed */
    int log_count;
    char log[512]; /* the last line */
} check_host;

static inline void *check_reallocate(void *user, void *pointer, size_t size) {
    check_host *host = (check_host *)user;
    void *result;
    if (size == 0) {
        if (pointer) host->live--;
        free(pointer);
        return NULL;
    }
    host->calls++;
    if (host->fail_from && host->calls >= host->fail_from) return NULL;
    result = realloc(pointer, size);
    if (result && !pointer) host->live++;
    return result;
}

static inline void check_log(void *user, dgfem_log_level level, const char *text) {
    check_host *host = (check_host *)user;
    (void)level;
    host->log_count++;
    snprintf(host->log, sizeof host->log, "%s", text);
}

/* Zeroes the host and returns hooks that use it. */
static inline dgfem_hooks check_hooks(check_host *host) {
    dgfem_hooks hooks;
    memset(host, 0, sizeof *host);
    memset(&hooks, 0, sizeof hooks);
    hooks.reallocate = check_reallocate;
    hooks.reallocate_user = host;
    hooks.log = check_log;
    hooks.log_user = host;
    return hooks;
}

/* The last line that was logged contains `part`, and no other line was logged since the last call. */
#define check_logged(host, part) check_logged_at((host), (part), __FILE__, __LINE__)

static inline void check_logged_at(check_host *host, const char *part, const char *file, int line) {
    int count = host->log_count;
    host->log_count = 0;
    if (count == 1 && strstr(host->log, part)) return;
    print_error("%d log lines, the last one \"%s\", instead of one with \"%s\"\n", count, host->log, part);
    _fail(file, line);
}

/* Calls `run`, which creates with the given hooks and destroys again what it got, first with every allocation failing,
   then with all but one, and so on until it succeeds. Each failure must be DGFEM_ERROR_MEMORY and log one line, and
   nothing may stay allocated. Returns the number of allocations. */
static inline long check_every_allocation(dgfem_status (*run)(void *context, const dgfem_hooks *hooks), void *context) {
    long fail_from;
    for (fail_from = 1;; fail_from++) {
        check_host host;
        dgfem_hooks hooks = check_hooks(&host);
        dgfem_status status;
        host.fail_from = fail_from;
        status = run(context, &hooks);
        assert_int_equal(host.live, 0);
        if (host.calls < fail_from) { /* no allocation failed */
            check_status(status, DGFEM_OK);
            assert_int_equal(host.log_count, 0);
            return host.calls;
        }
        check_status(status, DGFEM_ERROR_MEMORY);
        check_logged(&host, "out of memory");
    }
}

#endif
