/* Conjugate gradients with block-Jacobi. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_matrix.h"
#include "check_threads.h"

/* One system with its right-hand side, all random. */
typedef struct system_under_test {
    check_blocks blocks;
    dgfem_matrix *matrix;
    dgfem_real *b, *x;
} system_under_test;

static system_under_test system_make(check_blocks blocks, check_random *random, double dominance) {
    system_under_test s;
    s.blocks = blocks;
    s.matrix = check_matrix_make(&blocks, 0);
    check_matrix_fill(s.matrix, random, dominance);
    s.b = check_vector_random(random, s.matrix->size);
    s.x = check_vector_random(random, s.matrix->size);
    return s;
}

static void system_free(system_under_test *s) {
    dgfem_matrix_destroy(s->matrix);
    free(s->b);
    free(s->x);
    check_blocks_free(&s->blocks);
}

/* |b - A x| / |b| in the norm of D^-1, all by dense elimination. */
static double true_residual(const system_under_test *s, const dgfem_real *x) {
    int n = s->matrix->size, k, i, j;
    double *dense = check_dense(s->matrix), top = 0, bottom = 0;
    for (k = 0; k < s->matrix->block_count; k++) {
        int first = s->matrix->offset[k], size = check_matrix_size(s->matrix, k), pass;
        for (pass = 0; pass < 2; pass++) {
            double *block = (double *)calloc((size_t)(size * size), sizeof(double)), *z;
            dgfem_real *r = (dgfem_real *)calloc((size_t)size, sizeof(dgfem_real));
            assert_true(block && r);
            for (i = 0; i < size; i++) {
                double sum = (double)s->b[first + i];
                for (j = 0; j < n && pass == 0; j++) sum -= dense[(first + i) * n + j] * (double)x[j];
                r[i] = (dgfem_real)sum;
                for (j = 0; j < size; j++) block[i * size + j] = dense[(first + i) * n + first + j];
            }
            z = check_dense_solve(block, size, r);
            for (i = 0; i < size; i++) *(pass == 0 ? &top : &bottom) += (double)r[i] * z[i];
            free(block);
            free(z);
            free(r);
        }
    }
    free(dense);
    return sqrt(top / bottom);
}

static void random_systems_match_the_dense_solution(void **state) {
    check_random random = check_random_seeded(1);
    int round, i;
    (void)state;
    for (round = 0; round < 20; round++) {
        int count = 1 + check_random_int(&random, 30);
        system_under_test s =
            system_make(check_blocks_random(&random, count, check_random_int(&random, 3 * count)), &random, 1.5);
        dgfem_pcg_desc desc = dgfem_default_pcg_desc();
        dgfem_pcg_info info;
        double *dense = check_dense(s.matrix), *expected = check_dense_solve(dense, s.matrix->size, s.b);
        double size = 0, error = 0, tolerance = 64 * CHECK_EPSILON;
        desc.tolerance = (dgfem_real)tolerance;
        check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_OK);
        assert_in_range(info.iterations, 1, 40);
        assert_int_equal(info.failed_block, DGFEM_NONE);
        check_near(info.residual, 0, tolerance);
        check_near(true_residual(&s, s.x), info.residual, 8 * CHECK_EPSILON);
        for (i = 0; i < s.matrix->size; i++) {
            size += expected[i] * expected[i];
            error += ((double)s.x[i] - expected[i]) * ((double)s.x[i] - expected[i]);
        }
        check_near(sqrt(error), 0, 25 * tolerance * sqrt(size)); /* the condition is about 5, twice for the norms */
        free(dense);
        free(expected);
        system_free(&s);
    }
}

static void uncoupled_blocks_need_one_iteration(void **state) {
    check_random random = check_random_seeded(2);
    system_under_test s = system_make(check_blocks_make(30, 12), &random, 1.2);
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    dgfem_pcg_info info;
    (void)state;
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_OK);
    assert_int_equal(info.iterations, 1);
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_OK); /* from the solution */
    assert_int_equal(info.iterations, 0);
    system_free(&s);
}

/* A Laplacian of n unknowns has n eigenvalues: n iterations at most in exact arithmetic. */
static void a_chain_needs_as_many_iterations_as_unknowns(void **state) {
    check_blocks blocks = check_blocks_chain(50, 1);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 0);
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    dgfem_pcg_info info;
    dgfem_real b[50] = {0}, x[50] = {0};
    int i;
    (void)state;
    for (i = 0; i < 50; i++) dgfem_matrix_block(matrix, i, i)[0] = 2;
    for (i = 1; i < 50; i++) dgfem_matrix_block(matrix, i, i - 1)[0] = -1;
    b[0] = 1;
    check_status(dgfem_pcg(matrix, &desc, b, x, &info), DGFEM_OK);
    assert_in_range(info.iterations, 25, 52);
    for (i = 0; i < 50; i++) check_near(x[i], (50 - i) / 51.0, 200 * (double)desc.tolerance);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

static void zero_right_hand_side_gives_zero_at_once(void **state) {
    check_random random = check_random_seeded(3);
    system_under_test s = system_make(check_blocks_grid(3, 3, 3, 4), &random, 1.5);
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    dgfem_pcg_info info;
    int i;
    (void)state;
    for (i = 0; i < s.matrix->size; i++) s.b[i] = 0;
    desc.max_iterations = 0;
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_OK);
    assert_int_equal(info.iterations, 0);
    assert_true(info.residual == 0);
    for (i = 0; i < s.matrix->size; i++) assert_true(s.x[i] == 0);
    system_free(&s);
}

/* With too few iterations x is the best iterate so far: its residual is that reported, and never grows with the
   limit. */
static void too_few_iterations_leave_the_best_iterate(void **state) {
    check_random random = check_random_seeded(4);
    system_under_test s = system_make(check_blocks_grid(5, 5, 5, 3), &random, 1.001);
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    dgfem_real *start = check_vector_random(&random, s.matrix->size);
    double last = true_residual(&s, start);
    check_host host;
    int limit;
    (void)state;
    desc.tolerance = (dgfem_real)(16 * CHECK_EPSILON);
    desc.hooks = check_hooks(&host);
    for (limit = 0; limit < 8; limit++) {
        dgfem_pcg_info info;
        desc.max_iterations = limit;
        memcpy(s.x, start, (size_t)s.matrix->size * sizeof *start);
        check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_ERROR_NOT_CONVERGED);
        check_logged(&host, "iterations");
        assert_int_equal(info.iterations, limit);
        check_near(info.residual, true_residual(&s, s.x), 32 * CHECK_EPSILON * last);
        assert_true((double)info.residual <= last * (1 + 8 * CHECK_EPSILON));
        last = (double)info.residual;
    }
    free(start);
    system_free(&s);
}

/* No tolerance but zero: the iteration ends where round-off ends it, with x as good as it gets. */
static void unreachable_tolerance_ends_without_progress(void **state) {
    check_random random = check_random_seeded(5);
    system_under_test s = system_make(check_blocks_grid(4, 4, 4, 6), &random, 1.1);
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    dgfem_pcg_info info;
    (void)state;
    desc.tolerance = 0;
    desc.max_iterations = 400;
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_ERROR_NOT_CONVERGED);
    check_near(info.residual, 0, 64 * CHECK_EPSILON);
    check_near(check_residual(s.matrix, s.b, s.x), 0, 16 * CHECK_EPSILON);
    system_free(&s);
}

static void breakdowns_are_reported(void **state) {
    check_random random = check_random_seeded(6);
    system_under_test s = system_make(check_blocks_chain(8, 3), &random, 1.5);
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    dgfem_pcg_info info;
    dgfem_real *block, kept;
    check_host host;
    int i;
    (void)state;
    desc.hooks = check_hooks(&host);
    block = dgfem_matrix_block(s.matrix, 5, 5);
    kept = block[4];
    block[4] = -1; /* a diagonal block that is not positive definite */
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
    assert_int_equal(info.failed_block, 5);
    check_logged(&host, "block 5");
    block[4] = (dgfem_real)NAN;
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
    assert_int_equal(info.failed_block, 5);
    check_logged(&host, "block 5");
    block[4] = kept;
    block = dgfem_matrix_block(s.matrix, 4, 3);
    for (i = 0; i < 9; i++) block[i] = 100; /* indefinite, though all diagonal blocks are definite */
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_ERROR_NOT_CONVERGED);
    check_logged(&host, "residual");
    for (i = 0; i < s.matrix->size; i++) assert_true(isfinite(s.x[i]));
    check_near(info.residual, true_residual(&s, s.x), 64 * CHECK_EPSILON * (double)info.residual);
    block[0] = (dgfem_real)NAN;
    memset(s.x, 0, (size_t)s.matrix->size * sizeof *s.x);
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, &info), DGFEM_ERROR_NOT_CONVERGED);
    for (i = 0; i < s.matrix->size; i++) assert_true(s.x[i] == 0);
    assert_int_equal(host.live, 0);
    system_free(&s);
}

static void bad_arguments_are_refused(void **state) {
    check_random random = check_random_seeded(7);
    system_under_test s = system_make(check_blocks_chain(3, 2), &random, 1.5);
    dgfem_pcg_desc good = dgfem_default_pcg_desc(), desc;
    dgfem_real kept = s.b[2];
    check_host host;
    (void)state;
    good.hooks = check_hooks(&host);
    check_status(dgfem_pcg(s.matrix, NULL, s.b, s.x, NULL), DGFEM_ERROR_DESCRIPTOR);
    desc = good, desc.cookie ^= 1;
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, NULL), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_pcg(NULL, &good, s.b, s.x, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    check_status(dgfem_pcg(s.matrix, &good, NULL, s.x, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    check_status(dgfem_pcg(s.matrix, &good, s.b, NULL, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    check_status(dgfem_pcg(s.matrix, &good, s.b, s.b, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "b is x");
    desc = good, desc.tolerance = (dgfem_real)NAN;
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "tolerance");
    desc = good, desc.tolerance = -1;
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "tolerance");
    desc = good, desc.max_iterations = -1;
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "max_iterations");
    s.b[2] = (dgfem_real)INFINITY;
    check_status(dgfem_pcg(s.matrix, &good, s.b, s.x, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "b[2]");
    s.b[2] = kept, s.x[5] = (dgfem_real)NAN;
    check_status(dgfem_pcg(s.matrix, &good, s.b, s.x, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "x[5]");
    assert_int_equal(host.calls, 0);
    assert_int_equal(dgfem_pcg_work_size(NULL), 0);
    system_free(&s);
}

static dgfem_status solve_allocating(void *context, const dgfem_hooks *hooks) {
    const system_under_test *s = (const system_under_test *)context;
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    desc.hooks = *hooks;
    return dgfem_pcg(s->matrix, &desc, s->b, s->x, NULL);
}

static void memory_is_one_allocation_or_the_callers(void **state) {
    check_random random = check_random_seeded(8);
    system_under_test s = system_make(check_blocks_random(&random, 20, 40), &random, 1.5);
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    size_t size = dgfem_pcg_work_size(s.matrix), expected = 5 * (size_t)s.matrix->size;
    dgfem_real *again = check_vector_random(&random, s.matrix->size);
    check_host host;
    int k;
    (void)state;
    assert_int_equal(check_every_allocation(solve_allocating, &s), 1);
    for (k = 0; k < 20; k++) expected += (size_t)(s.blocks.sizes[k] * s.blocks.sizes[k]);
    assert_int_equal(size, expected);
    desc.hooks = check_hooks(&host);
    desc.work = (dgfem_real *)malloc(size * sizeof(dgfem_real));
    memset(s.x, 0, (size_t)s.matrix->size * sizeof *s.x);
    memset(again, 0, (size_t)s.matrix->size * sizeof *s.x);
    check_status(dgfem_pcg(s.matrix, &desc, s.b, s.x, NULL), DGFEM_OK);
    check_status(dgfem_pcg(s.matrix, &desc, s.b, again, NULL), DGFEM_OK);
    assert_memory_equal(s.x, again, (size_t)s.matrix->size * sizeof *again); /* the work's contents do not matter */
    assert_int_equal(host.calls, 0);
    free(desc.work);
    free(again);
    system_free(&s);
}

/* Of a system that is shared: every number of the result, and of two bad blocks the first is named. */
static void workers_change_no_bit(void **state) {
    check_random random = check_random_seeded(9);
    check_blocks blocks = check_blocks_grid(9, 9, 9, 12);
    dgfem_matrix *alone = check_matrix_make(&blocks, 0);
    dgfem_real *b = check_vector_random(&random, alone->size), *x = check_vector_random(&random, alone->size);
    dgfem_real *y = check_vector_random(&random, alone->size);
    size_t values = alone->value_start[alone->row_start[alone->block_count]];
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    dgfem_pcg_info info, other;
    int k;
    (void)state;
    check_matrix_fill(alone, &random, 1.1);
    memset(x, 0, (size_t)alone->size * sizeof *x);
    check_status(dgfem_pcg(alone, &desc, b, x, &info), DGFEM_OK);
    assert_true(info.iterations > 3);
    for (k = 1; k <= 3; k++) {
        dgfem_matrix_desc matrix_desc = check_matrix_desc(&blocks, 0);
        dgfem_matrix *shared = NULL;
        check_workers workers;
        workers.count = k, workers.loops = 0;
        matrix_desc.hooks.parallel_for = check_parallel_for, matrix_desc.hooks.parallel_for_user = &workers;
        check_status(dgfem_matrix_create(&matrix_desc, &shared), DGFEM_OK);
        memcpy(shared->values, alone->values, values * sizeof *b);
        memset(y, 0, (size_t)alone->size * sizeof *y);
        check_status(dgfem_pcg(shared, &desc, b, y, &other), DGFEM_OK);
        assert_memory_equal(x, y, (size_t)alone->size * sizeof *x);
        assert_int_equal(other.iterations, info.iterations);
        assert_true(other.residual == info.residual);
        assert_true(workers.loops > info.iterations);
        *dgfem_matrix_block(shared, 700, 700) = -1;
        *dgfem_matrix_block(shared, 250, 250) = (dgfem_real)NAN;
        check_status(dgfem_pcg(shared, &desc, b, y, &other), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
        assert_int_equal(other.failed_block, 250);
        dgfem_matrix_destroy(shared);
    }
    free(b);
    free(x);
    free(y);
    dgfem_matrix_destroy(alone);
    check_blocks_free(&blocks);
}

static void empty_system_is_solved(void **state) {
    dgfem_matrix_desc matrix_desc = dgfem_default_matrix_desc();
    dgfem_pcg_desc desc = dgfem_default_pcg_desc();
    dgfem_matrix *matrix = NULL;
    dgfem_real b = 1, x = 2;
    (void)state;
    check_status(dgfem_matrix_create(&matrix_desc, &matrix), DGFEM_OK);
    check_status(dgfem_pcg(matrix, &desc, &b, &x, NULL), DGFEM_OK);
    assert_true(x == 2);
    dgfem_matrix_destroy(matrix);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_systems_match_the_dense_solution),
        cmocka_unit_test(uncoupled_blocks_need_one_iteration),
        cmocka_unit_test(a_chain_needs_as_many_iterations_as_unknowns),
        cmocka_unit_test(zero_right_hand_side_gives_zero_at_once),
        cmocka_unit_test(too_few_iterations_leave_the_best_iterate),
        cmocka_unit_test(unreachable_tolerance_ends_without_progress),
        cmocka_unit_test(breakdowns_are_reported),
        cmocka_unit_test(bad_arguments_are_refused),
        cmocka_unit_test(memory_is_one_allocation_or_the_callers),
        cmocka_unit_test(workers_change_no_bit),
        cmocka_unit_test(empty_system_is_solved),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
