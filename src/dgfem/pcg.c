#pragma once
#include "sparse.c"
/* Preconditioned conjugate gradients with block-Jacobi: M = the diagonal blocks, each factored by dense Cholesky. The
   residual is measured in the norm of M^-1, the one that conjugate gradients compute anyway. */

DGFEM_API dgfem_pcg_desc dgfem_default_pcg_desc(void) {
    dgfem_pcg_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-5) : DGFEM_R(1e-8);
    desc.max_iterations = 1000;
    return desc;
}

DGFEM_API size_t dgfem_pcg_work_size(const dgfem_matrix *matrix) {
    size_t size = 5 * (size_t)matrix->size;
    for (int r = 0; r < matrix->block_count; r++) {
        size_t n = (size_t)dgfemi_block_size(matrix, r);
        size += n * n;
    }
    return size;
}

/* Factors of all diagonal blocks, one after the other. Returns the first block that is not positive definite, or
   DGFEM_NONE. */
static int dgfemi_factor_diagonal(const dgfem_matrix *matrix, dgfem_real *factors) {
    for (int r = 0; r < matrix->block_count; r++) {
        int n = dgfemi_block_size(matrix, r);
        memcpy(factors, dgfem_matrix_block(matrix, r, r), (size_t)(n * n) * sizeof *factors);
        if (!dgfemi_cholesky_dense(factors, n)) return r;
        factors += n * n;
    }
    return DGFEM_NONE;
}

/* z = M^-1 r */
static void dgfemi_precondition(const dgfem_matrix *matrix, const dgfem_real *factors, const dgfem_real *r,
                                dgfem_real *z) {
    memcpy(z, r, (size_t)matrix->size * sizeof *z);
    for (int b = 0; b < matrix->block_count; b++) {
        int n = dgfemi_block_size(matrix, b);
        dgfemi_cholesky_dense_solve(factors, n, z + matrix->offset[b], 1);
        factors += n * n;
    }
}

static dgfem_real dgfemi_dot_n(const dgfem_real *x, const dgfem_real *y, int n) {
    dgfem_real sum = 0;
    for (int i = 0; i < n; i++) sum += x[i] * y[i];
    return sum;
}

/* |v| in the norm of M^-1; z is overwritten. */
static dgfem_real dgfemi_residual_norm(const dgfem_matrix *matrix, const dgfem_real *factors, const dgfem_real *v,
                                       dgfem_real *z) {
    dgfemi_precondition(matrix, factors, v, z);
    return dgfemi_sqrt(dgfemi_max(dgfemi_dot_n(v, z, matrix->size), 0));
}

/* The iteration. On DGFEM_ERROR_NOT_CONVERGED x is the iterate with the smallest residual. */
static dgfem_status dgfemi_pcg(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                               dgfem_real *x, dgfem_real *work, dgfem_pcg_info *info) {
    int n = matrix->size;
    size_t bytes = (size_t)n * sizeof *x;
    dgfem_real *r = work, *z = r + n, *p = z + n, *q = p + n, *best = q + n, *factors = best + n;
    info->failed_block = dgfemi_factor_diagonal(matrix, factors);
    if (info->failed_block != DGFEM_NONE) return DGFEM_ERROR_NOT_POSITIVE_DEFINITE;

    dgfem_real scale = dgfemi_residual_norm(matrix, factors, b, z);
    if (scale == 0) {
        memset(x, 0, bytes);
        return DGFEM_OK;
    }
    dgfem_matrix_multiply(matrix, x, r);
    for (int i = 0; i < n; i++) r[i] = b[i] - r[i];
    dgfemi_precondition(matrix, factors, r, z);
    dgfem_real rz = dgfemi_dot_n(r, z, n), best_residual;
    memcpy(p, z, bytes);
    memcpy(best, x, bytes);
    info->residual = best_residual = dgfemi_sqrt(dgfemi_max(rz, 0)) / scale;

    while (!(info->residual <= desc->tolerance) && info->iterations < desc->max_iterations) {
        dgfem_matrix_multiply(matrix, p, q);
        dgfem_real pq = dgfemi_dot_n(p, q, n), alpha = rz / pq;
        if (!(pq > 0) || !dgfemi_is_finite(alpha)) break; /* not definite, or NaN */
        for (int i = 0; i < n; i++) x[i] += alpha * p[i], r[i] -= alpha * q[i];
        dgfemi_precondition(matrix, factors, r, z);
        dgfem_real next = dgfemi_dot_n(r, z, n), beta = next / rz;
        for (int i = 0; i < n; i++) p[i] = z[i] + beta * p[i];
        rz = next;
        info->iterations++;
        info->residual = dgfemi_sqrt(dgfemi_max(rz, 0)) / scale;
        if (info->residual < best_residual) {
            best_residual = info->residual;
            memcpy(best, x, bytes);
        }
    }
    if (info->residual <= desc->tolerance) return DGFEM_OK;
    memcpy(x, best, bytes);
    info->residual = best_residual;
    return DGFEM_ERROR_NOT_CONVERGED;
}

static dgfem_status dgfemi_check_pcg(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                     const dgfem_real *x) {
    if (!matrix || (matrix->size > 0 && (!b || !x)))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "pcg: no matrix or vector");
    if (!(desc->tolerance > 0) || desc->max_iterations < 0)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "pcg: tolerance %g, max_iterations %d",
                           (double)desc->tolerance, desc->max_iterations);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_pcg(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                 dgfem_real *x, dgfem_pcg_info *info) {
    dgfem_pcg_info local;
    memset(&local, 0, sizeof local);
    local.failed_block = DGFEM_NONE;
    if (info) *info = local;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (!status) status = dgfemi_check_pcg(matrix, desc, b, x);
    if (status) return status;
    dgfem_real *work = desc->work;
    if (!work) work = (dgfem_real *)dgfemi_allocate(&desc->hooks, dgfem_pcg_work_size(matrix), sizeof *work);
    if (!work) return dgfemi_fail_memory(&desc->hooks);
    status = dgfemi_pcg(matrix, desc, b, x, work, &local);
    if (!desc->work) dgfemi_free(&desc->hooks, work);
    if (info) *info = local;
    if (status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE)
        return dgfemi_fail(&desc->hooks, status, "pcg: diagonal block %d", local.failed_block);
    if (status)
        return dgfemi_fail(&desc->hooks, status, "pcg: residual %g after %d iterations, expected %g",
                           (double)local.residual, local.iterations, (double)desc->tolerance);
    return DGFEM_OK;
}
