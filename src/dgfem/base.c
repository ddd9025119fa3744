#pragma once
#include "api.h"
/* Status texts, allocation, growable arrays, log, parallel-for, strided points. */

#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef DGFEM_ASSERT
#include <assert.h>
#define DGFEM_ASSERT(condition) assert(condition)
#endif

#if defined(__GNUC__) || defined(__clang__)
#define DGFEM_PRINTF(format_index, first) __attribute__((format(printf, format_index, first)))
#else
#define DGFEM_PRINTF(format_index, first)
#endif

/* For kernels that are written once and specialised by constant arguments. */
#if defined(__GNUC__) || defined(__clang__)
#define DGFEM_INLINE static inline __attribute__((always_inline))
#else
#define DGFEM_INLINE static inline
#endif

DGFEM_API const char *dgfem_status_text(dgfem_status status) {
    static const char *const texts[] = {
#define DGFEM_STATUS_TEXT(name, text) text,
        DGFEM_STATUS_LIST(DGFEM_STATUS_TEXT)
#undef DGFEM_STATUS_TEXT
    };
    if ((int)status < 0 || status >= DGFEM_STATUS_COUNT) return "unknown status";
    return texts[status];
}

/* ---- log ---- */

/* Logs one line and returns the status, so that a check reads `return dgfemi_fail(...)`. */
DGFEM_PRINTF(3, 4)
static dgfem_status dgfemi_fail(const dgfem_hooks *hooks, dgfem_status status, const char *format, ...) {
    char text[512];
    va_list arguments;
    size_t used;
    if (!hooks->log) return status;
    snprintf(text, sizeof text, "dgfem: %s: ", dgfem_status_text(status));
    used = strlen(text);
    va_start(arguments, format);
    vsnprintf(text + used, sizeof text - used, format, arguments);
    va_end(arguments);
    hooks->log(hooks->log_user, DGFEM_LOG_ERROR, text);
    return status;
}

static dgfem_status dgfemi_fail_memory(const dgfem_hooks *hooks) {
    return dgfemi_fail(hooks, DGFEM_ERROR_MEMORY, "the allocator returned NULL");
}

/* ---- descriptors ---- */

#define DGFEM_COOKIE 0xd6fe3501u /* planted by every default function; catches a descriptor that was never initialised */

/* A descriptor is good when it exists and carries the cookie. The hooks of a bad one cannot be trusted: no log. */
static dgfem_status dgfemi_check_cookie(const void *desc, unsigned cookie) {
    return desc && cookie == DGFEM_COOKIE ? DGFEM_OK : DGFEM_ERROR_DESCRIPTOR;
}

/* ---- memory ---- */

static void *dgfemi_reallocate(const dgfem_hooks *hooks, void *pointer, size_t count, size_t size) {
    if (size && count > (size_t)PTRDIFF_MAX / size) return NULL;
    if (hooks->reallocate) return hooks->reallocate(hooks->reallocate_user, pointer, count * size);
    return realloc(pointer, count * size);
}

/* Room for at least one item, so that NULL always means failure. */
static void *dgfemi_allocate(const dgfem_hooks *hooks, size_t count, size_t size) {
    return dgfemi_reallocate(hooks, NULL, count ? count : 1, size);
}

static void *dgfemi_allocate_zero(const dgfem_hooks *hooks, size_t count, size_t size) {
    void *pointer = dgfemi_allocate(hooks, count, size);
    if (pointer) memset(pointer, 0, (count ? count : 1) * size);
    return pointer;
}

static void dgfemi_free(const dgfem_hooks *hooks, void *pointer) {
    if (!pointer) return;
    if (hooks->reallocate) (void)hooks->reallocate(hooks->reallocate_user, pointer, 0);
    else free(pointer);
}

static void *dgfemi_duplicate(const dgfem_hooks *hooks, const void *source, size_t count, size_t size) {
    void *copy = dgfemi_allocate(hooks, count, size);
    if (copy && count) memcpy(copy, source, count * size);
    return copy;
}

/* Grows an array to hold `needed` items, at least doubling it. Returns the new array; on failure NULL, and the old one
   stays valid. */
static void *dgfemi_grow(const dgfem_hooks *hooks, void *data, int *capacity, int needed, size_t size) {
    int wanted = *capacity < INT_MAX / 2 ? 2 * *capacity : INT_MAX;
    void *grown;
    DGFEM_ASSERT(needed > *capacity);
    if (wanted < needed) wanted = needed;
    if (wanted < 16) wanted = 16;
    grown = dgfemi_reallocate(hooks, data, (size_t)wanted, size);
    if (grown) *capacity = wanted;
    return grown;
}

/* A growable array of indices. */
typedef struct dgfemi_ints {
    int *data;
    int count, capacity;
} dgfemi_ints;

/* 1 on success, 0 when out of memory. */
static int dgfemi_push(const dgfem_hooks *hooks, dgfemi_ints *ints, int value) {
    if (ints->count == ints->capacity) {
        int *grown = (int *)dgfemi_grow(hooks, ints->data, &ints->capacity, ints->count + 1, sizeof(int));
        if (!grown) return 0;
        ints->data = grown;
    }
    ints->data[ints->count++] = value;
    return 1;
}

/* Temporary memory of one operation: many small allocations, one release. Zeroed memory is a valid empty arena once
   `hooks` is set. */
typedef struct dgfemi_arena_block {
    struct dgfemi_arena_block *next;
    size_t used, size; /* bytes behind the header */
} dgfemi_arena_block;

typedef struct dgfemi_arena {
    const dgfem_hooks *hooks;
    dgfemi_arena_block *blocks;
} dgfemi_arena;

#define DGFEM_ARENA_ALIGN ((size_t)64)

static dgfemi_arena dgfemi_arena_make(const dgfem_hooks *hooks) {
    dgfemi_arena arena;
    arena.hooks = hooks;
    arena.blocks = NULL;
    return arena;
}

static void *dgfemi_arena_allocate(dgfemi_arena *arena, size_t count, size_t size) {
    dgfemi_arena_block *block = arena->blocks;
    size_t bytes, start;
    if (size && count > (size_t)PTRDIFF_MAX / 4 / size) return NULL;
    bytes = (count * size + DGFEM_ARENA_ALIGN) & ~(DGFEM_ARENA_ALIGN - 1);
    if (!block || block->size - block->used < bytes) {
        size_t room = block ? 2 * block->size : 4096;
        if (room < bytes) room = bytes;
        block = (dgfemi_arena_block *)dgfemi_allocate(arena->hooks, sizeof *block + room + DGFEM_ARENA_ALIGN, 1);
        if (!block) return NULL;
        start = (size_t)(DGFEM_ARENA_ALIGN - (uintptr_t)(block + 1) % DGFEM_ARENA_ALIGN);
        block->next = arena->blocks;
        block->used = start;
        block->size = room + DGFEM_ARENA_ALIGN;
        arena->blocks = block;
    }
    start = block->used;
    block->used += bytes;
    return (char *)(block + 1) + start;
}

static void *dgfemi_arena_allocate_zero(dgfemi_arena *arena, size_t count, size_t size) {
    void *pointer = dgfemi_arena_allocate(arena, count, size);
    if (pointer && count > 0) memset(pointer, 0, count * size);
    return pointer;
}

static void dgfemi_arena_free(dgfemi_arena *arena) {
    while (arena->blocks) {
        dgfemi_arena_block *next = arena->blocks->next;
        dgfemi_free(arena->hooks, arena->blocks);
        arena->blocks = next;
    }
}

/* Empties an arena but for its largest block, which serves again. */
static void dgfemi_arena_reuse(dgfemi_arena *arena) {
    dgfemi_arena rest = *arena;
    if (!arena->blocks) return;
    rest.blocks = arena->blocks->next;
    dgfemi_arena_free(&rest);
    arena->blocks->next = NULL;
    arena->blocks->used = (size_t)(DGFEM_ARENA_ALIGN - (uintptr_t)(arena->blocks + 1) % DGFEM_ARENA_ALIGN);
}

/* ---- parallel loops and time ---- */

static void dgfemi_parallel_for(const dgfem_hooks *hooks, int count, int grain, dgfem_range_fn fn, void *context) {
    if (count <= 0) return;
    if (hooks->parallel_for && count > grain)
        hooks->parallel_for(hooks->parallel_for_user, count, grain, fn, context);
    else
        fn(context, 0, count);
}

static double dgfemi_clock(const dgfem_hooks *hooks) { return hooks->clock ? hooks->clock(hooks->clock_user) : 0.0; }

/* ---- scalars ---- */

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_EPSILON 1.1920929e-7f
#else
#define DGFEM_EPSILON 2.220446049250313e-16
#endif

static dgfem_real dgfemi_sqrt(dgfem_real x) { return (dgfem_real)sqrt((double)x); }
static dgfem_real dgfemi_abs(dgfem_real x) { return x < 0 ? -x : x; }
static dgfem_real dgfemi_min(dgfem_real a, dgfem_real b) { return a < b ? a : b; }
static dgfem_real dgfemi_max(dgfem_real a, dgfem_real b) { return a > b ? a : b; }
static int dgfemi_is_finite(dgfem_real x) { return x - x == 0; }

/* ---- strided points ---- */

static size_t dgfemi_point_stride(dgfem_number type, int stride) {
    if (stride) return (size_t)stride;
    return 3 * (type == DGFEM_FLOAT32 ? sizeof(float) : sizeof(double));
}

static dgfem_vec3 dgfemi_point_read(const dgfem_points_in *points, int i) {
    const char *data = (const char *)points->data + (size_t)i * dgfemi_point_stride(points->type, points->stride);
    dgfem_vec3 p;
    if (points->type == DGFEM_FLOAT32) {
        float v[3];
        memcpy(v, data, sizeof v);
        p.x = (dgfem_real)v[0], p.y = (dgfem_real)v[1], p.z = (dgfem_real)v[2];
    } else {
        double v[3];
        memcpy(v, data, sizeof v);
        p.x = (dgfem_real)v[0], p.y = (dgfem_real)v[1], p.z = (dgfem_real)v[2];
    }
    return p;
}

static void dgfemi_point_write(const dgfem_points_out *points, int i, dgfem_vec3 p) {
    char *data = (char *)points->data + (size_t)i * dgfemi_point_stride(points->type, points->stride);
    if (points->type == DGFEM_FLOAT32) {
        float v[3];
        v[0] = (float)p.x, v[1] = (float)p.y, v[2] = (float)p.z;
        memcpy(data, v, sizeof v);
    } else {
        double v[3];
        v[0] = (double)p.x, v[1] = (double)p.y, v[2] = (double)p.z;
        memcpy(data, v, sizeof v);
    }
}

/* A usable descriptor of points: data where there is a count, a known type, a stride that holds three numbers. */
static dgfem_status dgfemi_check_points(const dgfem_hooks *hooks, const void *data, dgfem_number type, int stride,
                                        int count, const char *what) {
    if (count < 0 || (count > 0 && !data))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: no data for %d points", what, count);
    if (type != DGFEM_FLOAT32 && type != DGFEM_FLOAT64)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: unknown number type %d", what, (int)type);
    if (stride != 0 && (stride < 0 || (size_t)stride < dgfemi_point_stride(type, 0)))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: a stride of %d bytes does not hold a point", what, stride);
    return DGFEM_OK;
}

static dgfem_points_in dgfemi_points_in(const void *data, dgfem_number type, int count) {
    dgfem_points_in points;
    points.data = data, points.type = type, points.stride = 0, points.count = count;
    return points;
}

static dgfem_points_out dgfemi_points_out(void *data, dgfem_number type, int count) {
    dgfem_points_out points;
    points.data = data, points.type = type, points.stride = 0, points.count = count;
    return points;
}

#define DGFEM_NUMBER_OF_REAL (DGFEM_REAL_IS_FLOAT ? DGFEM_FLOAT32 : DGFEM_FLOAT64)

DGFEM_API dgfem_points_in dgfem_points_in_float(const float *data, int count) {
    return dgfemi_points_in(data, DGFEM_FLOAT32, count);
}
DGFEM_API dgfem_points_in dgfem_points_in_double(const double *data, int count) {
    return dgfemi_points_in(data, DGFEM_FLOAT64, count);
}
DGFEM_API dgfem_points_in dgfem_points_in_vec3(const dgfem_vec3 *data, int count) {
    return dgfemi_points_in(data, DGFEM_NUMBER_OF_REAL, count);
}
DGFEM_API dgfem_points_out dgfem_points_out_float(float *data, int count) {
    return dgfemi_points_out(data, DGFEM_FLOAT32, count);
}
DGFEM_API dgfem_points_out dgfem_points_out_double(double *data, int count) {
    return dgfemi_points_out(data, DGFEM_FLOAT64, count);
}
DGFEM_API dgfem_points_out dgfem_points_out_vec3(dgfem_vec3 *data, int count) {
    return dgfemi_points_out(data, DGFEM_NUMBER_OF_REAL, count);
}
