#pragma once
#include "api.h"
/* Log, memory and small vectors of this header's own. */

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
#define DGFEM_MVC_PRINTF(format_index, first) __attribute__((format(printf, format_index, first)))
#else
#define DGFEM_MVC_PRINTF(format_index, first)
#endif

#define DGFEM_MVC_COOKIE 0x3c5c0001u

/* ---- log ---- */

/* Logs one line and returns the status. */
DGFEM_MVC_PRINTF(3, 4)
static dgfem_status dgfem_mvci_fail(const dgfem_hooks *hooks, dgfem_status status, const char *format, ...) {
    char text[512];
    if (!hooks->log) return status;
    snprintf(text, sizeof text, "dgfem_mvc: %s: ", dgfem_status_text(status));
    size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, sizeof text - used, format, arguments);
    va_end(arguments);
    hooks->log(hooks->log_user, DGFEM_LOG_ERROR, text);
    return status;
}

static dgfem_status dgfem_mvci_fail_memory(const dgfem_hooks *hooks) {
    return dgfem_mvci_fail(hooks, DGFEM_ERROR_MEMORY, "the allocator returned NULL");
}

/* ---- memory ---- */

static void *dgfem_mvci_reallocate(const dgfem_hooks *hooks, void *pointer, size_t count, size_t size) {
    if (!count) count = 1; /* NULL always means failure */
    if (count > (size_t)PTRDIFF_MAX / size) return NULL;
    if (hooks->reallocate) return hooks->reallocate(hooks->reallocate_user, pointer, count * size);
    return realloc(pointer, count * size);
}

/* Zeroed. */
static void *dgfem_mvci_allocate(const dgfem_hooks *hooks, size_t count, size_t size) {
    void *pointer = dgfem_mvci_reallocate(hooks, NULL, count, size);
    if (pointer) memset(pointer, 0, (count ? count : 1) * size);
    return pointer;
}

static void *dgfem_mvci_duplicate(const dgfem_hooks *hooks, const void *source, size_t count, size_t size) {
    void *copy = dgfem_mvci_allocate(hooks, count, size);
    if (copy && count) memcpy(copy, source, count * size);
    return copy;
}

static void dgfem_mvci_free(const dgfem_hooks *hooks, void *pointer) {
    if (!pointer) return;
    if (hooks->reallocate) (void)hooks->reallocate(hooks->reallocate_user, pointer, 0);
    else free(pointer);
}

/* Temporary memory of one operation. Zeroed memory with `hooks` set is empty. */
typedef struct dgfem_mvci_scratch {
    const dgfem_hooks *hooks;
    void *blocks[32];
    int count;
} dgfem_mvci_scratch;

static dgfem_mvci_scratch dgfem_mvci_scratch_make(const dgfem_hooks *hooks) {
    dgfem_mvci_scratch scratch;
    memset(&scratch, 0, sizeof scratch);
    scratch.hooks = hooks;
    return scratch;
}

static void *dgfem_mvci_take(dgfem_mvci_scratch *scratch, size_t count, size_t size) {
    DGFEM_ASSERT(scratch->count < 32);
    void *pointer = dgfem_mvci_allocate(scratch->hooks, count, size);
    if (pointer) scratch->blocks[scratch->count++] = pointer;
    return pointer;
}

static void dgfem_mvci_scratch_free(dgfem_mvci_scratch *scratch) {
    while (scratch->count) dgfem_mvci_free(scratch->hooks, scratch->blocks[--scratch->count]);
}

/* ---- time and parallel loops ---- */

/* fn for ranges of 0 <= i < count, in the caller's threads where there are any. */
static void dgfem_mvci_run(const dgfem_hooks *hooks, int count, int grain, dgfem_range_fn fn, void *context) {
    if (hooks->parallel_for && count > grain) hooks->parallel_for(hooks->parallel_for_user, count, grain, fn, context);
    else fn(context, 0, count);
}

static double dgfem_mvci_clock(const dgfem_hooks *hooks) { return hooks->clock ? hooks->clock(hooks->clock_user) : 0; }

/* ---- scalars and vectors ---- */

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_MVC_EPSILON 1.1920929e-7f
#else
#define DGFEM_MVC_EPSILON 2.220446049250313e-16
#endif

static dgfem_real dgfem_mvci_sqrt(dgfem_real x) { return (dgfem_real)sqrt((double)x); }
static dgfem_real dgfem_mvci_abs(dgfem_real x) { return x < 0 ? -x : x; }
static dgfem_real dgfem_mvci_max(dgfem_real a, dgfem_real b) { return a > b ? a : b; }
static int dgfem_mvci_is_finite(dgfem_real x) { return x - x == 0; }

static dgfem_vec3 dgfem_mvci_vec3(dgfem_real x, dgfem_real y, dgfem_real z) {
    dgfem_vec3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}
static dgfem_vec3 dgfem_mvci_add(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_mvci_vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}
static dgfem_vec3 dgfem_mvci_sub(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_mvci_vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static dgfem_vec3 dgfem_mvci_scale(dgfem_real s, dgfem_vec3 a) { return dgfem_mvci_vec3(s * a.x, s * a.y, s * a.z); }
static dgfem_vec3 dgfem_mvci_axpy(dgfem_vec3 a, dgfem_real s, dgfem_vec3 b) {
    return dgfem_mvci_vec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
/* s a + t b */
static dgfem_vec3 dgfem_mvci_blend(dgfem_real s, dgfem_vec3 a, dgfem_real t, dgfem_vec3 b) {
    return dgfem_mvci_axpy(dgfem_mvci_scale(s, a), t, b);
}
static dgfem_real dgfem_mvci_dot(dgfem_vec3 a, dgfem_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static dgfem_vec3 dgfem_mvci_cross(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_mvci_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static dgfem_real dgfem_mvci_norm(dgfem_vec3 a) { return dgfem_mvci_sqrt(dgfem_mvci_dot(a, a)); }
/* The zero vector stays zero. */
static dgfem_vec3 dgfem_mvci_unit(dgfem_vec3 a) {
    dgfem_real length = dgfem_mvci_norm(a);
    return length > 0 ? dgfem_mvci_scale(1 / length, a) : a;
}
static int dgfem_mvci_is_finite3(dgfem_vec3 a) {
    return dgfem_mvci_is_finite(a.x) && dgfem_mvci_is_finite(a.y) && dgfem_mvci_is_finite(a.z);
}

static dgfem_mat3 dgfem_mvci_identity(void) {
    dgfem_mat3 a;
    memset(&a, 0, sizeof a);
    a.m[0][0] = a.m[1][1] = a.m[2][2] = 1;
    return a;
}
static dgfem_vec3 dgfem_mvci_multiply(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfem_mvci_vec3(a->m[0][0] * v.x + a->m[0][1] * v.y + a->m[0][2] * v.z,
                           a->m[1][0] * v.x + a->m[1][1] * v.y + a->m[1][2] * v.z,
                           a->m[2][0] * v.x + a->m[2][1] * v.y + a->m[2][2] * v.z);
}
static dgfem_vec3 dgfem_mvci_multiply_transposed(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfem_mvci_vec3(a->m[0][0] * v.x + a->m[1][0] * v.y + a->m[2][0] * v.z,
                           a->m[0][1] * v.x + a->m[1][1] * v.y + a->m[2][1] * v.z,
                           a->m[0][2] * v.x + a->m[1][2] * v.y + a->m[2][2] * v.z);
}
static dgfem_mat3 dgfem_mvci_multiply3(const dgfem_mat3 *a, const dgfem_mat3 *b) {
    dgfem_mat3 c;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j];
    return c;
}
static dgfem_mat3 dgfem_mvci_transposed(const dgfem_mat3 *a) {
    dgfem_mat3 t;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) t.m[i][j] = a->m[j][i];
    return t;
}
/* a += s u v^T */
static void dgfem_mvci_add_outer(dgfem_mat3 *a, dgfem_real s, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_vec3 su = dgfem_mvci_scale(s, u);
    a->m[0][0] += su.x * v.x, a->m[0][1] += su.x * v.y, a->m[0][2] += su.x * v.z;
    a->m[1][0] += su.y * v.x, a->m[1][1] += su.y * v.y, a->m[1][2] += su.y * v.z;
    a->m[2][0] += su.z * v.x, a->m[2][1] += su.z * v.y, a->m[2][2] += su.z * v.z;
}
/* Inverse of a symmetric matrix by cofactors; 0 where it has none. */
static int dgfem_mvci_invert(const dgfem_mat3 *a, dgfem_mat3 *out) {
    dgfem_vec3 r[3], c[3];
    for (int i = 0; i < 3; i++) r[i] = dgfem_mvci_vec3(a->m[i][0], a->m[i][1], a->m[i][2]);
    for (int i = 0; i < 3; i++) c[i] = dgfem_mvci_cross(r[(i + 1) % 3], r[(i + 2) % 3]);
    dgfem_real det = dgfem_mvci_dot(r[0], c[0]);
    if (!(dgfem_mvci_abs(det) > 0) || !dgfem_mvci_is_finite(det)) return 0;
    for (int j = 0; j < 3; j++) {
        out->m[0][j] = c[j].x / det;
        out->m[1][j] = c[j].y / det;
        out->m[2][j] = c[j].z / det;
    }
    return 1;
}

/* ---- strided points ---- */

static dgfem_status dgfem_mvci_check_points(const dgfem_hooks *hooks, const dgfem_points_in *points, const char *what) {
    int size = points->type == DGFEM_FLOAT32 ? 12 : 24;
    if (points->count < 0 || (points->count > 0 && !points->data))
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: no data for %d points", what, points->count);
    if (points->type != DGFEM_FLOAT32 && points->type != DGFEM_FLOAT64)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: unknown number type %d", what, (int)points->type);
    if (points->stride && points->stride < size)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: a stride of %d bytes does not hold a point", what,
                               points->stride);
    return DGFEM_OK;
}

static dgfem_vec3 dgfem_mvci_read_point(const dgfem_points_in *points, int i) {
    size_t size = points->type == DGFEM_FLOAT32 ? 12 : 24;
    const char *data = (const char *)points->data + (size_t)i * (points->stride ? (size_t)points->stride : size);
    float f[3];
    double d[3];
    if (points->type == DGFEM_FLOAT64) {
        memcpy(d, data, sizeof d);
        return dgfem_mvci_vec3((dgfem_real)d[0], (dgfem_real)d[1], (dgfem_real)d[2]);
    }
    memcpy(f, data, sizeof f);
    return dgfem_mvci_vec3((dgfem_real)f[0], (dgfem_real)f[1], (dgfem_real)f[2]);
}
