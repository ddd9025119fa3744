#pragma once
#include "api.h"
/* Log, memory and small vectors of the shells' own. */

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
#define DGFEM_SHELL_PRINTF(format_index, first) __attribute__((format(printf, format_index, first)))
#else
#define DGFEM_SHELL_PRINTF(format_index, first)
#endif

#define DGFEM_SHELL_COOKIE 0x5e110001u

/* ---- log ---- */

/* Logs one line and returns the status. */
DGFEM_SHELL_PRINTF(3, 4)
static dgfem_status dgfem_shelli_fail(const dgfem_hooks *hooks, dgfem_status status, const char *format, ...) {
    char text[512];
    if (!hooks->log) return status;
    snprintf(text, sizeof text, "dgfem_shell: %s: ", dgfem_status_text(status));
    size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, sizeof text - used, format, arguments);
    va_end(arguments);
    hooks->log(hooks->log_user, DGFEM_LOG_ERROR, text);
    return status;
}

static dgfem_status dgfem_shelli_fail_memory(const dgfem_hooks *hooks) {
    return dgfem_shelli_fail(hooks, DGFEM_ERROR_MEMORY, "the allocator returned NULL");
}

/* ---- memory ---- */

static void *dgfem_shelli_reallocate(const dgfem_hooks *hooks, void *pointer, size_t count, size_t size) {
    if (!count) count = 1; /* NULL always means failure */
    if (count > (size_t)PTRDIFF_MAX / size) return NULL;
    if (hooks->reallocate) return hooks->reallocate(hooks->reallocate_user, pointer, count * size);
    return realloc(pointer, count * size);
}

/* Zeroed. */
static void *dgfem_shelli_allocate(const dgfem_hooks *hooks, size_t count, size_t size) {
    void *pointer = dgfem_shelli_reallocate(hooks, NULL, count, size);
    if (pointer) memset(pointer, 0, (count ? count : 1) * size);
    return pointer;
}

static void *dgfem_shelli_duplicate(const dgfem_hooks *hooks, const void *source, size_t count, size_t size) {
    void *copy = dgfem_shelli_allocate(hooks, count, size);
    if (copy && count) memcpy(copy, source, count * size);
    return copy;
}

static void dgfem_shelli_free(const dgfem_hooks *hooks, void *pointer) {
    if (!pointer) return;
    if (hooks->reallocate) (void)hooks->reallocate(hooks->reallocate_user, pointer, 0);
    else free(pointer);
}

/* Temporary memory of one operation. Zeroed memory with `hooks` set is empty. */
typedef struct dgfem_shelli_scratch {
    const dgfem_hooks *hooks;
    void *blocks[32];
    int count;
} dgfem_shelli_scratch;

static dgfem_shelli_scratch dgfem_shelli_scratch_make(const dgfem_hooks *hooks) {
    dgfem_shelli_scratch scratch;
    memset(&scratch, 0, sizeof scratch);
    scratch.hooks = hooks;
    return scratch;
}

static void *dgfem_shelli_take(dgfem_shelli_scratch *scratch, size_t count, size_t size) {
    DGFEM_ASSERT(scratch->count < 32);
    void *pointer = dgfem_shelli_allocate(scratch->hooks, count, size);
    if (pointer) scratch->blocks[scratch->count++] = pointer;
    return pointer;
}

static void dgfem_shelli_scratch_free(dgfem_shelli_scratch *scratch) {
    while (scratch->count) dgfem_shelli_free(scratch->hooks, scratch->blocks[--scratch->count]);
}

static double dgfem_shelli_clock(const dgfem_hooks *hooks) {
    return hooks->clock ? hooks->clock(hooks->clock_user) : 0;
}

/* ---- scalars and vectors ---- */

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_SHELL_EPSILON 1.1920929e-7f
#else
#define DGFEM_SHELL_EPSILON 2.220446049250313e-16
#endif

static dgfem_real dgfem_shelli_sqrt(dgfem_real x) { return (dgfem_real)sqrt((double)x); }
static dgfem_real dgfem_shelli_abs(dgfem_real x) { return x < 0 ? -x : x; }
static dgfem_real dgfem_shelli_max(dgfem_real a, dgfem_real b) { return a > b ? a : b; }
static int dgfem_shelli_is_finite(dgfem_real x) { return x - x == 0; }

static dgfem_vec3 dgfem_shelli_vec3(dgfem_real x, dgfem_real y, dgfem_real z) {
    dgfem_vec3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}
static dgfem_vec3 dgfem_shelli_add(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_shelli_vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}
static dgfem_vec3 dgfem_shelli_sub(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_shelli_vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static dgfem_vec3 dgfem_shelli_scale(dgfem_real s, dgfem_vec3 a) {
    return dgfem_shelli_vec3(s * a.x, s * a.y, s * a.z);
}
static dgfem_vec3 dgfem_shelli_axpy(dgfem_vec3 a, dgfem_real s, dgfem_vec3 b) {
    return dgfem_shelli_vec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
static dgfem_real dgfem_shelli_dot(dgfem_vec3 a, dgfem_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static dgfem_vec3 dgfem_shelli_cross(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_shelli_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static dgfem_real dgfem_shelli_norm(dgfem_vec3 a) { return dgfem_shelli_sqrt(dgfem_shelli_dot(a, a)); }
/* The zero vector stays zero. */
static dgfem_vec3 dgfem_shelli_unit(dgfem_vec3 a) {
    dgfem_real length = dgfem_shelli_norm(a);
    return length > 0 ? dgfem_shelli_scale(1 / length, a) : a;
}
static int dgfem_shelli_is_finite3(dgfem_vec3 a) {
    return dgfem_shelli_is_finite(a.x) && dgfem_shelli_is_finite(a.y) && dgfem_shelli_is_finite(a.z);
}

static dgfem_mat3 dgfem_shelli_identity(void) {
    dgfem_mat3 a;
    memset(&a, 0, sizeof a);
    a.m[0][0] = a.m[1][1] = a.m[2][2] = 1;
    return a;
}
static dgfem_vec3 dgfem_shelli_multiply(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfem_shelli_vec3(a->m[0][0] * v.x + a->m[0][1] * v.y + a->m[0][2] * v.z,
                             a->m[1][0] * v.x + a->m[1][1] * v.y + a->m[1][2] * v.z,
                             a->m[2][0] * v.x + a->m[2][1] * v.y + a->m[2][2] * v.z);
}
static dgfem_vec3 dgfem_shelli_multiply_transposed(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfem_shelli_vec3(a->m[0][0] * v.x + a->m[1][0] * v.y + a->m[2][0] * v.z,
                             a->m[0][1] * v.x + a->m[1][1] * v.y + a->m[2][1] * v.z,
                             a->m[0][2] * v.x + a->m[1][2] * v.y + a->m[2][2] * v.z);
}
static dgfem_mat3 dgfem_shelli_multiply3(const dgfem_mat3 *a, const dgfem_mat3 *b) {
    dgfem_mat3 c;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j];
    return c;
}
static dgfem_mat3 dgfem_shelli_transposed(const dgfem_mat3 *a) {
    dgfem_mat3 t;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) t.m[i][j] = a->m[j][i];
    return t;
}
/* a += s u v^T */
static void dgfem_shelli_add_outer(dgfem_mat3 *a, dgfem_real s, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_vec3 su = dgfem_shelli_scale(s, u);
    a->m[0][0] += su.x * v.x, a->m[0][1] += su.x * v.y, a->m[0][2] += su.x * v.z;
    a->m[1][0] += su.y * v.x, a->m[1][1] += su.y * v.y, a->m[1][2] += su.y * v.z;
    a->m[2][0] += su.z * v.x, a->m[2][1] += su.z * v.y, a->m[2][2] += su.z * v.z;
}
/* [v]x, the matrix of w -> v x w */
static dgfem_mat3 dgfem_shelli_cross_matrix(dgfem_vec3 v) {
    dgfem_mat3 a;
    memset(&a, 0, sizeof a);
    a.m[0][1] = -v.z, a.m[0][2] = v.y;
    a.m[1][0] = v.z, a.m[1][2] = -v.x;
    a.m[2][0] = -v.y, a.m[2][1] = v.x;
    return a;
}
/* Rotation by an angle about a unit axis. */
static dgfem_mat3 dgfem_shelli_rotation(dgfem_vec3 axis, dgfem_real angle) {
    dgfem_real c = (dgfem_real)cos((double)angle), s = (dgfem_real)sin((double)angle);
    dgfem_mat3 r = dgfem_shelli_cross_matrix(dgfem_shelli_scale(s, axis));
    for (int i = 0; i < 3; i++) r.m[i][i] += c;
    dgfem_shelli_add_outer(&r, 1 - c, axis, axis);
    return r;
}
/* Unit axis of a rotation, and its angle in [0, pi], from the quaternion: its largest component has all digits. The
   axis of no rotation is zero. */
static dgfem_vec3 dgfem_shelli_axis_of(const dgfem_mat3 *r, dgfem_real *angle) {
    dgfem_real d[3], trace = r->m[0][0] + r->m[1][1] + r->m[2][2], v[3], w;
    int i = 0;
    for (int k = 0; k < 3; k++) d[k] = r->m[k][k];
    for (int k = 1; k < 3; k++)
        if (d[k] > d[i]) i = k;
    int j = (i + 1) % 3, k = (i + 2) % 3;
    if (trace > d[i]) { /* four times w (w, v); else four times v_i (w, v) */
        w = 1 + trace;
        for (int c = 0; c < 3; c++) v[c] = r->m[(c + 2) % 3][(c + 1) % 3] - r->m[(c + 1) % 3][(c + 2) % 3];
    } else {
        w = r->m[k][j] - r->m[j][k];
        v[i] = 1 + 2 * d[i] - trace;
        v[j] = r->m[i][j] + r->m[j][i];
        v[k] = r->m[i][k] + r->m[k][i];
    }
    dgfem_vec3 axis = dgfem_shelli_vec3(v[0], v[1], v[2]);
    if (w < 0) axis = dgfem_shelli_scale(-1, axis), w = -w;
    *angle = (dgfem_real)(2 * atan2((double)dgfem_shelli_norm(axis), (double)w));
    return dgfem_shelli_unit(axis);
}
static dgfem_real dgfem_shelli_determinant(const dgfem_mat3 *a) {
    dgfem_vec3 r[3];
    for (int i = 0; i < 3; i++) r[i] = dgfem_shelli_vec3(a->m[i][0], a->m[i][1], a->m[i][2]);
    return dgfem_shelli_dot(r[0], dgfem_shelli_cross(r[1], r[2]));
}
/* Inverse of a symmetric matrix by cofactors; 0 where it has none. */
static int dgfem_shelli_invert(const dgfem_mat3 *a, dgfem_mat3 *out) {
    dgfem_vec3 r[3], c[3];
    for (int i = 0; i < 3; i++) r[i] = dgfem_shelli_vec3(a->m[i][0], a->m[i][1], a->m[i][2]);
    for (int i = 0; i < 3; i++) c[i] = dgfem_shelli_cross(r[(i + 1) % 3], r[(i + 2) % 3]);
    dgfem_real det = dgfem_shelli_dot(r[0], c[0]);
    if (!(dgfem_shelli_abs(det) > 0) || !dgfem_shelli_is_finite(det)) return 0;
    for (int j = 0; j < 3; j++) {
        out->m[0][j] = c[j].x / det;
        out->m[1][j] = c[j].y / det;
        out->m[2][j] = c[j].z / det;
    }
    return 1;
}

/* ---- strided points ---- */

static dgfem_status dgfem_shelli_check_points(const dgfem_hooks *hooks, const dgfem_points_in *points,
                                              const char *what) {
    int size = points->type == DGFEM_FLOAT32 ? 12 : 24;
    if (points->count < 0 || (points->count > 0 && !points->data))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: no data for %d points", what, points->count);
    if (points->type != DGFEM_FLOAT32 && points->type != DGFEM_FLOAT64)
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: unknown number type %d", what, (int)points->type);
    if (points->stride && points->stride < size)
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: a stride of %d bytes does not hold a point", what,
                                 points->stride);
    return DGFEM_OK;
}

static dgfem_vec3 dgfem_shelli_read_point(const dgfem_points_in *points, int i) {
    size_t size = points->type == DGFEM_FLOAT32 ? 12 : 24;
    const char *data = (const char *)points->data + (size_t)i * (points->stride ? (size_t)points->stride : size);
    float f[3];
    double d[3];
    if (points->type == DGFEM_FLOAT64) {
        memcpy(d, data, sizeof d);
        return dgfem_shelli_vec3((dgfem_real)d[0], (dgfem_real)d[1], (dgfem_real)d[2]);
    }
    memcpy(f, data, sizeof f);
    return dgfem_shelli_vec3((dgfem_real)f[0], (dgfem_real)f[1], (dgfem_real)f[2]);
}
