#pragma once
#include "linalg.c"
#include "sparse.c"
/* Conjugate gradients, preconditioned by the inverse diagonal blocks. */

DGFEM_API dgfem_pcg_desc dgfem_default_pcg_desc(void) {
    dgfem_pcg_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-5) : DGFEM_R(1e-8);
    desc.max_iterations = 1000;
    return desc;
}

/* ---- vectors ---- */

/* In chunks of a fixed length, so that the sum does not depend on who adds up which chunk; in double, so that no
   squares vanish in single precision. */
static double dgfemi_vector_dot(int count, const dgfem_real *x, const dgfem_real *y) {
    enum { CHUNK = 1024 };
    double total = 0;
    int first, i, k;
    for (first = 0; first < count; first += CHUNK) {
        int last = count - first < CHUNK ? count : first + CHUNK;
        double sum[4] = {0};
        for (i = first; i + 4 <= last; i += 4)
            for (k = 0; k < 4; k++) sum[k] += (double)x[i + k] * (double)y[i + k];
        for (; i < last; i++) sum[0] += (double)x[i] * (double)y[i];
        total += (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
    return total;
}

/* y = x + s y */
static void dgfemi_vector_scale_add(int count, const dgfem_real *x, dgfem_real s, dgfem_real *y) {
    int i;
    for (i = 0; i < count; i++) y[i] = x[i] + s * y[i];
}

/* y += s x */
static void dgfemi_vector_add(int count, dgfem_real s, const dgfem_real *x, dgfem_real *y) {
    int i;
    for (i = 0; i < count; i++) y[i] += s * x[i];
}

/* ---- block-Jacobi ---- */

/* From L with A = L L^T (lower half, row-major) to the whole of A^-1 = L^-T L^-1, in place. */
static void dgfemi_invert_from_cholesky(dgfem_real *a, int size) {
    size_t n = (size_t)size, i, j, k;
    for (j = 0; j < n; j++) { /* column j of L^-1: the columns behind it are still those of L */
        a[j * n + j] = 1 / a[j * n + j];
        for (i = j + 1; i < n; i++) {
            dgfem_real sum = 0;
            for (k = j; k < i; k++) sum += a[i * n + k] * a[k * n + j];
            a[i * n + j] = -sum / a[i * n + i];
        }
    }
    for (j = 0; j < n; j++)
        for (i = j; i < n; i++) {
            dgfem_real sum = 0;
            for (k = i; k < n; k++) sum += a[k * n + i] * a[k * n + j];
            a[i * n + j] = a[j * n + i] = sum;
        }
}

/* Inverts all diagonal blocks into `inverse`, one behind the other. Returns a block that is not positive definite, or
   DGFEM_NONE. */
static int dgfemi_invert_diagonal(const dgfem_matrix *matrix, dgfem_real *inverse) {
    int r;
    for (r = 0; r < matrix->block_count; r++) {
        int n = dgfemi_block_size(matrix, r);
        size_t count = (size_t)n * (size_t)n, from = matrix->value_start[dgfemi_diagonal_index(matrix, r)];
        memcpy(inverse, matrix->values + from, count * sizeof *inverse);
        if (!dgfemi_cholesky_dense(inverse, n)) return r;
        dgfemi_invert_from_cholesky(inverse, n);
        inverse += count;
    }
    return DGFEM_NONE;
}

/* z = D^-1 r */
static void dgfemi_precondition(const dgfem_matrix *matrix, const dgfem_real *inverse, const dgfem_real *r,
                                dgfem_real *z) {
    int k;
    memset(z, 0, (size_t)matrix->size * sizeof *z);
    for (k = 0; k < matrix->block_count; k++) {
        int n = dgfemi_block_size(matrix, k), first = matrix->offset[k];
        dgfemi_block_multiply(inverse, n, n, r + first, z + first);
        inverse += (size_t)n * (size_t)n;
    }
}

/* ---- iteration ---- */

typedef struct dgfemi_pcg {
    const dgfem_matrix *matrix;
    const dgfem_real *b;
    dgfem_real *x;
    dgfem_real *r, *z, *p, *q; /* residual, D^-1 r, direction, A p */
    dgfem_real *best;          /* the iterate of the smallest residual */
    dgfem_real *inverse;       /* of the diagonal blocks */
    double norm;               /* b . D^-1 b */
    double rho;                /* r . D^-1 r */
    double best_rho;
} dgfemi_pcg;

static void dgfemi_pcg_set_best(dgfemi_pcg *s) {
    s->best_rho = s->rho;
    memcpy(s->best, s->x, (size_t)s->matrix->size * sizeof *s->x);
}

/* The residual itself, not as carried along; and a new start from it. */
static void dgfemi_pcg_restart(dgfemi_pcg *s) {
    int n = s->matrix->size, i;
    dgfem_matrix_multiply(s->matrix, s->x, s->q);
    for (i = 0; i < n; i++) s->r[i] = s->b[i] - s->q[i];
    dgfemi_precondition(s->matrix, s->inverse, s->r, s->z);
    memcpy(s->p, s->z, (size_t)n * sizeof *s->p);
    s->rho = dgfemi_vector_dot(n, s->r, s->z);
    dgfemi_pcg_set_best(s);
}

/* One step of Hestenes and Stiefel. 0 on breakdown: A or D^-1 is not positive definite, or a number not finite. */
static int dgfemi_pcg_iterate(dgfemi_pcg *s) {
    int n = s->matrix->size;
    double curvature, rho;
    dgfem_real step;
    dgfem_matrix_multiply(s->matrix, s->p, s->q);
    curvature = dgfemi_vector_dot(n, s->p, s->q);
    step = (dgfem_real)(s->rho / curvature);
    if (!(curvature > 0) || !(step > 0) || !dgfemi_is_finite(step)) return 0;
    dgfemi_vector_add(n, step, s->p, s->x);
    dgfemi_vector_add(n, -step, s->q, s->r);
    dgfemi_precondition(s->matrix, s->inverse, s->r, s->z);
    rho = dgfemi_vector_dot(n, s->r, s->z);
    if (!(rho >= 0) || !(rho - rho == 0)) return 0;
    dgfemi_vector_scale_add(n, s->z, (dgfem_real)(rho / s->rho), s->p);
    s->rho = rho;
    return 1;
}

/* 1 when converged. The residual that is carried along drifts from the true one, and keeps falling where that cannot:
   when it is small enough, or as small as round-off, the true one is computed and the iteration starts anew from it, as
   long as this gains something. */
static int dgfemi_pcg_run(dgfemi_pcg *s, const dgfem_pcg_desc *desc, int *iterations) {
    double target = (double)desc->tolerance * (double)desc->tolerance * s->norm;
    double noise = (double)DGFEM_EPSILON * (double)DGFEM_EPSILON * s->norm, last_true;
    *iterations = 0;
    dgfemi_pcg_restart(s);
    last_true = s->rho;
    while (!(s->rho <= target)) {
        if (*iterations == desc->max_iterations || !dgfemi_pcg_iterate(s)) return 0;
        ++*iterations;
        if (s->rho < s->best_rho) dgfemi_pcg_set_best(s);
        if (s->rho > target && s->rho > noise) continue;
        dgfemi_pcg_restart(s);
        if (s->rho > target && !(s->rho < last_true / 4)) return 0;
        last_true = s->rho;
    }
    return 1;
}

/* `work` has room for dgfem_pcg_work_size. Returns OK, NOT_POSITIVE_DEFINITE or NOT_CONVERGED. */
static dgfem_status dgfemi_pcg_solve(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                     dgfem_real *x, dgfem_real *work, dgfem_pcg_info *info) {
    dgfemi_pcg solver, *s = &solver;
    size_t n = (size_t)matrix->size;
    int converged;
    s->matrix = matrix;
    s->b = b;
    s->x = x;
    s->r = work, s->z = work + n, s->p = work + 2 * n, s->q = work + 3 * n, s->best = work + 4 * n;
    s->inverse = work + 5 * n;
    info->failed_block = dgfemi_invert_diagonal(matrix, s->inverse);
    if (info->failed_block != DGFEM_NONE) return DGFEM_ERROR_NOT_POSITIVE_DEFINITE;
    dgfemi_precondition(matrix, s->inverse, b, s->z);
    s->norm = dgfemi_vector_dot(matrix->size, b, s->z);
    info->residual = (dgfem_real)HUGE_VAL;
    if (!(s->norm > 0) || !(s->norm - s->norm == 0)) return DGFEM_ERROR_NOT_CONVERGED;
    converged = dgfemi_pcg_run(s, desc, &info->iterations);
    if (!converged) {
        memcpy(x, s->best, n * sizeof *x);
        dgfemi_pcg_restart(s);
    }
    info->residual = (dgfem_real)sqrt(s->rho / s->norm);
    return converged ? DGFEM_OK : DGFEM_ERROR_NOT_CONVERGED;
}

DGFEM_API size_t dgfem_pcg_work_size(const dgfem_matrix *matrix) {
    size_t total = 0;
    int r;
    if (!matrix) return 0;
    for (r = 0; r < matrix->block_count; r++) {
        size_t n = (size_t)dgfemi_block_size(matrix, r);
        total += 5 * n + n * n;
    }
    return total;
}

static dgfem_status dgfemi_pcg_check(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                     const dgfem_real *x) {
    const dgfem_hooks *hooks = &desc->hooks;
    int i;
    if (!matrix || !b || !x || b == x)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "pcg: matrix, b or x is NULL, or b is x");
    if (!(desc->tolerance >= 0) || !dgfemi_is_finite(desc->tolerance))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "pcg: tolerance %g", (double)desc->tolerance);
    if (desc->max_iterations < 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "pcg: max_iterations %d", desc->max_iterations);
    i = dgfemi_vector_not_finite(matrix->size, b);
    if (i != DGFEM_NONE) return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "pcg: b[%d]", i);
    i = dgfemi_vector_not_finite(matrix->size, x);
    if (i != DGFEM_NONE) return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "pcg: x[%d]", i);
    return DGFEM_OK;
}

static int dgfemi_vector_is_zero(int count, const dgfem_real *x) {
    int i;
    for (i = 0; i < count; i++)
        if (x[i] != 0) return 0;
    return 1;
}

DGFEM_API dgfem_status dgfem_pcg(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                 dgfem_real *x, dgfem_pcg_info *info) {
    dgfem_pcg_info result;
    dgfem_real *work;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    memset(&result, 0, sizeof result);
    result.failed_block = DGFEM_NONE;
    if (info) *info = result;
    if (!status) status = dgfemi_pcg_check(matrix, desc, b, x);
    if (status) return status;
    if (dgfemi_vector_is_zero(matrix->size, b)) {
        memset(x, 0, (size_t)matrix->size * sizeof *x);
        return DGFEM_OK;
    }
    work = desc->work;
    if (!work) work = (dgfem_real *)dgfemi_allocate(&desc->hooks, dgfem_pcg_work_size(matrix), sizeof(dgfem_real));
    if (!work) return dgfemi_fail_memory(&desc->hooks);
    status = dgfemi_pcg_solve(matrix, desc, b, x, work, &result);
    if (!desc->work) dgfemi_free(&desc->hooks, work);
    if (info) *info = result;
    if (status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE)
        return dgfemi_fail(&desc->hooks, status, "pcg: diagonal block %d", result.failed_block);
    if (status)
        return dgfemi_fail(&desc->hooks, status, "pcg: residual %g after %d iterations", (double)result.residual,
                           result.iterations);
    return DGFEM_OK;
}
