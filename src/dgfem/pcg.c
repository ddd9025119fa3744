#pragma once
#include "linalg.c"
#include "sparse.c"
/* Preconditioned conjugate gradients; by the inverse diagonal blocks, and for what else is near the matrix. */

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

/* 0 when the block is not positive definite. */
static int dgfemi_invert_diagonal_block(const dgfem_matrix *matrix, int r, dgfem_real *inverse) {
    int n = dgfemi_block_size(matrix, r);
    size_t count = (size_t)n * (size_t)n, from = matrix->value_start[dgfemi_diagonal_index(matrix, r)];
    memcpy(inverse, matrix->values + from, count * sizeof *inverse);
    if (!dgfemi_cholesky_dense(inverse, n)) return 0;
    dgfemi_invert_from_cholesky(inverse, n);
    return 1;
}

static void dgfemi_invert_rows(void *context, const dgfem_matrix *matrix, int first, int last, size_t diagonal) {
    dgfem_real *inverse = (dgfem_real *)context + diagonal;
    int r;
    for (r = first; r < last; r++) {
        int n = dgfemi_block_size(matrix, r);
        if (!dgfemi_invert_diagonal_block(matrix, r, inverse)) inverse[0] = (dgfem_real)-1;
        inverse += n * n;
    }
}

/* Inverts all diagonal blocks into `inverse`, one behind the other. Returns the first block that is not positive
   definite, or DGFEM_NONE. The first element of an inverse tells: it is positive. */
static int dgfemi_invert_diagonal(const dgfem_matrix *matrix, dgfem_real *inverse) {
    int r;
    dgfemi_for_rows(matrix, dgfemi_invert_rows, inverse);
    for (r = 0; r < matrix->block_count; r++) {
        int n = dgfemi_block_size(matrix, r);
        if (!(inverse[0] > 0)) return r;
        inverse += n * n;
    }
    return DGFEM_NONE;
}

/* z = P^-1 r, where P is symmetric, positive definite and near the matrix. */
typedef struct dgfemi_preconditioner {
    void (*apply)(void *context, const dgfem_real *r, dgfem_real *z);
    void *context;
} dgfemi_preconditioner;

/* P = D, the diagonal blocks. */
typedef struct dgfemi_jacobi {
    const dgfem_matrix *matrix;
    dgfem_real *inverse; /* of the blocks */
} dgfemi_jacobi;

typedef struct dgfemi_jacobi_vectors {
    const dgfem_real *inverse, *r;
    dgfem_real *z;
} dgfemi_jacobi_vectors;

static void dgfemi_apply_jacobi_rows(void *context, const dgfem_matrix *matrix, int first, int last, size_t diagonal) {
    const dgfemi_jacobi_vectors *vectors = (const dgfemi_jacobi_vectors *)context;
    const dgfemi_kernels *kernels = dgfemi_product_kernels();
    const dgfem_real *inverse = vectors->inverse + diagonal;
    int k;
    memset(vectors->z + matrix->offset[first], 0,
           (size_t)(matrix->offset[last] - matrix->offset[first]) * sizeof(dgfem_real));
    for (k = first; k < last; k++) {
        int n = dgfemi_block_size(matrix, k), at = matrix->offset[k];
        dgfemi_add_transposed_product(kernels, inverse, n, n, vectors->r + at, vectors->z + at);
        inverse += (size_t)n * (size_t)n;
    }
}

static void dgfemi_apply_jacobi(void *context, const dgfem_real *r, dgfem_real *z) {
    const dgfemi_jacobi *jacobi = (const dgfemi_jacobi *)context;
    dgfemi_jacobi_vectors vectors;
    vectors.inverse = jacobi->inverse, vectors.r = r, vectors.z = z;
    dgfemi_for_rows(jacobi->matrix, dgfemi_apply_jacobi_rows, &vectors);
}

/* ---- iteration ---- */

typedef struct dgfemi_pcg {
    const dgfem_matrix *matrix;
    dgfemi_preconditioner preconditioner;
    const dgfem_real *b;
    dgfem_real *x;
    dgfem_real *r, *z, *p, *q; /* residual, P^-1 r, direction, A p */
    dgfem_real step;           /* x moved last by step * p */
    double rho;                /* r . P^-1 r */
} dgfemi_pcg;

/* r = b - A x */
static void dgfemi_residual(const dgfem_matrix *matrix, const dgfem_real *b, const dgfem_real *x, dgfem_real *r) {
    int i;
    dgfem_matrix_multiply(matrix, x, r);
    for (i = 0; i < matrix->size; i++) r[i] = b[i] - r[i];
}

/* The residual itself, not as carried along. */
static void dgfemi_pcg_residual(dgfemi_pcg *s) { dgfemi_residual(s->matrix, s->b, s->x, s->r); }

/* The next direction, conjugate to the last one; the first where `last`, the rho of the last one, is 0. Returns 0 on
   breakdown: P is not positive definite, or a number is not finite. */
static int dgfemi_pcg_turn(dgfemi_pcg *s, double last) {
    s->preconditioner.apply(s->preconditioner.context, s->r, s->z);
    s->rho = dgfemi_vector_dot(s->matrix->size, s->r, s->z);
    if (!(s->rho >= 0) || !(s->rho - s->rho == 0)) return 0;
    if (last > 0) dgfemi_vector_scale_add(s->matrix->size, s->z, (dgfem_real)(s->rho / last), s->p);
    else memcpy(s->p, s->z, (size_t)s->matrix->size * sizeof *s->p);
    return 1;
}

/* x += step p, to the smallest error along p in the norm of A, and r with it. Returns 0 on breakdown: A is not positive
   definite, or a number is not finite. `descent` is r . p. */
static int dgfemi_pcg_advance(dgfemi_pcg *s, double descent) {
    int n = s->matrix->size;
    double curvature;
    dgfem_matrix_multiply(s->matrix, s->p, s->q);
    curvature = dgfemi_vector_dot(n, s->p, s->q);
    s->step = (dgfem_real)(descent / curvature);
    if (!(curvature > 0) || !dgfemi_is_finite(s->step)) return 0;
    dgfemi_vector_add(n, s->step, s->p, s->x);
    dgfemi_vector_add(n, -s->step, s->q, s->r);
    return 1;
}

/* Conjugate gradients to a given residual. */
typedef struct dgfemi_pcg_run {
    dgfemi_pcg cg;
    dgfem_real *best; /* the iterate of the smallest residual */
    double best_rho;
    double norm;      /* b . P^-1 b */
} dgfemi_pcg_run;

static void dgfemi_pcg_set_best(dgfemi_pcg_run *run) {
    run->best_rho = run->cg.rho;
    memcpy(run->best, run->cg.x, (size_t)run->cg.matrix->size * sizeof *run->best);
}

static int dgfemi_pcg_restart(dgfemi_pcg_run *run) {
    int good;
    dgfemi_pcg_residual(&run->cg);
    good = dgfemi_pcg_turn(&run->cg, 0);
    dgfemi_pcg_set_best(run);
    return good;
}

/* One step of Hestenes and Stiefel. 0 on breakdown. */
static int dgfemi_pcg_iterate(dgfemi_pcg *s) {
    double last = s->rho;
    return last > 0 && dgfemi_pcg_advance(s, last) && dgfemi_pcg_turn(s, last);
}

/* 1 when converged. The residual that is carried along drifts from the true one, and keeps falling where that cannot:
   when it is small enough, or as small as round-off, the true one is computed and the iteration starts anew from it, as
   long as this gains something. */
static int dgfemi_pcg_converge(dgfemi_pcg_run *run, const dgfem_pcg_desc *desc, int *iterations) {
    dgfemi_pcg *s = &run->cg;
    double target = (double)desc->tolerance * (double)desc->tolerance * run->norm;
    double noise = (double)DGFEM_EPSILON * (double)DGFEM_EPSILON * run->norm, last_true;
    *iterations = 0;
    (void)dgfemi_pcg_restart(run);
    last_true = s->rho;
    while (!(s->rho <= target)) {
        if (*iterations == desc->max_iterations || !dgfemi_pcg_iterate(s)) return 0;
        ++*iterations;
        if (s->rho < run->best_rho) dgfemi_pcg_set_best(run);
        if (s->rho > target && s->rho > noise) continue;
        (void)dgfemi_pcg_restart(run);
        if (s->rho > target && !(s->rho < last_true / 4)) return 0;
        last_true = s->rho;
    }
    return 1;
}

/* `work` has room for dgfem_pcg_work_size. Returns OK, NOT_POSITIVE_DEFINITE or NOT_CONVERGED. */
static dgfem_status dgfemi_pcg_solve(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                     dgfem_real *x, dgfem_real *work, dgfem_pcg_info *info) {
    dgfemi_pcg_run run;
    dgfemi_pcg *s = &run.cg;
    dgfemi_jacobi jacobi;
    size_t n = (size_t)matrix->size;
    int converged;
    memset(&run, 0, sizeof run);
    jacobi.matrix = matrix;
    jacobi.inverse = work + 5 * n;
    s->matrix = matrix;
    s->preconditioner.apply = dgfemi_apply_jacobi;
    s->preconditioner.context = &jacobi;
    s->b = b;
    s->x = x;
    s->r = work, s->z = work + n, s->p = work + 2 * n, s->q = work + 3 * n, run.best = work + 4 * n;
    info->failed_block = dgfemi_invert_diagonal(matrix, jacobi.inverse);
    if (info->failed_block != DGFEM_NONE) return DGFEM_ERROR_NOT_POSITIVE_DEFINITE;
    dgfemi_apply_jacobi(&jacobi, b, s->z);
    run.norm = dgfemi_vector_dot(matrix->size, b, s->z);
    info->residual = (dgfem_real)HUGE_VAL;
    if (!(run.norm > 0) || !(run.norm - run.norm == 0)) return DGFEM_ERROR_NOT_CONVERGED;
    converged = dgfemi_pcg_converge(&run, desc, &info->iterations);
    if (!converged) {
        memcpy(x, run.best, n * sizeof *x);
        (void)dgfemi_pcg_restart(&run);
    }
    info->residual = (dgfem_real)sqrt(s->rho / run.norm);
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
