/* The block matrix: its pattern, access to blocks, the product. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_matrix.h"
#include "check_threads.h"
#include <limits.h>

/* coupled[r * count + c], r >= c, by looking at every pair. */
static unsigned char *coupling(const check_blocks *blocks) {
    unsigned char *coupled = (unsigned char *)calloc((size_t)(blocks->count * blocks->count), 1);
    int i;
    assert_non_null(coupled);
    for (i = 0; i < blocks->pair_count; i++) {
        int a = blocks->pairs[2 * i], b = blocks->pairs[2 * i + 1];
        coupled[(a > b ? a : b) * blocks->count + (a > b ? b : a)] = 1;
    }
    for (i = 0; i < blocks->count; i++) coupled[i * blocks->count + i] = 1;
    return coupled;
}

static void check_pattern(const dgfem_matrix *matrix, const check_blocks *blocks) {
    unsigned char *coupled = coupling(blocks);
    size_t values = 0;
    int r, c, k = 0, offset = 0;
    assert_int_equal(matrix->block_count, blocks->count);
    for (r = 0; r < blocks->count; r++) {
        assert_int_equal(matrix->offset[r], offset);
        assert_int_equal(matrix->row_start[r], k);
        for (c = 0; c <= r; c++) {
            dgfem_real *block = dgfem_matrix_block(matrix, r, c);
            if (!coupled[r * blocks->count + c]) {
                assert_null(block);
                continue;
            }
            assert_int_equal(matrix->column[k], c);
            assert_int_equal(matrix->value_start[k], values);
            assert_ptr_equal(block, matrix->values + values);
            values += (size_t)blocks->sizes[r] * (size_t)blocks->sizes[c];
            k++;
        }
        offset += blocks->sizes[r];
    }
    assert_int_equal(matrix->row_start[blocks->count], k);
    assert_int_equal(matrix->value_start[k], values);
    assert_int_equal(matrix->offset[blocks->count], offset);
    assert_int_equal(matrix->size, offset);
    while (values > 0) assert_true(matrix->values[--values] == 0);
    free(coupled);
}

static void pattern_holds_each_pair_once_in_order(void **state) {
    check_random random = check_random_seeded(1);
    int round;
    (void)state;
    for (round = 0; round < 60; round++) {
        int count = 1 + check_random_int(&random, 40);
        check_blocks blocks = check_blocks_random(&random, count, check_random_int(&random, 3 * count));
        dgfem_matrix *matrix = check_matrix_make(&blocks, 0);
        check_pattern(matrix, &blocks);
        assert_null(matrix->centres);
        dgfem_matrix_destroy(matrix);
        check_blocks_free(&blocks);
    }
}

static void blocks_out_of_range_or_above_the_diagonal_are_absent(void **state) {
    check_blocks blocks = check_blocks_complete(3, 2);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 0);
    (void)state;
    assert_non_null(dgfem_matrix_block(matrix, 2, 0));
    assert_null(dgfem_matrix_block(matrix, 0, 2));
    assert_null(dgfem_matrix_block(matrix, -1, 0));
    assert_null(dgfem_matrix_block(matrix, 3, 0));
    assert_null(dgfem_matrix_block(matrix, 2, -1));
    assert_null(dgfem_matrix_block(NULL, 0, 0));
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

static void centres_are_copied(void **state) {
    check_blocks blocks = check_blocks_grid(2, 3, 1, 3);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
    (void)state;
    assert_ptr_not_equal(matrix->centres, blocks.centres);
    assert_memory_equal(matrix->centres, blocks.centres, 6 * sizeof(dgfem_vec3));
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

static void clear_makes_all_values_zero(void **state) {
    check_random random = check_random_seeded(2);
    check_blocks blocks = check_blocks_random(&random, 12, 20);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 0);
    (void)state;
    check_matrix_fill(matrix, &random, 1.5);
    dgfem_matrix_clear(matrix);
    check_pattern(matrix, &blocks);
    dgfem_matrix_clear(NULL);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

/* Against sums over the dense matrix; the tolerance is that of n additions. */
static void check_product(const check_blocks *blocks, check_random *random) {
    dgfem_matrix *matrix = check_matrix_make(blocks, 0);
    dgfem_real *x, *y, *again;
    double *dense;
    int n = matrix->size, i, j;
    check_matrix_fill(matrix, random, 1.5);
    dense = check_dense(matrix);
    x = check_vector_random(random, n);
    y = check_vector_random(random, n); /* whatever y held must not matter */
    again = check_vector_random(random, n);
    dgfem_matrix_multiply(matrix, x, y);
    dgfem_matrix_multiply(matrix, x, again);
    assert_memory_equal(y, again, (size_t)n * sizeof *y);
    for (i = 0; i < n; i++) {
        double sum = 0, size = 0;
        for (j = 0; j < n; j++) {
            sum += dense[i * n + j] * (double)x[j];
            size += fabs(dense[i * n + j] * (double)x[j]);
        }
        check_near(y[i], sum, CHECK_EPSILON * (n + 1) * size);
    }
    free(dense);
    free(x);
    free(y);
    free(again);
    dgfem_matrix_destroy(matrix);
}

static void product_equals_the_dense_one(void **state) {
    check_random random = check_random_seeded(3);
    int round, i;
    (void)state;
    for (round = 0; round < 20; round++) {
        int count = 1 + check_random_int(&random, 20);
        check_blocks blocks = check_blocks_random(&random, count, check_random_int(&random, 3 * count));
        if (round % 2) /* all widths and heights, and so every way to cut a block into strips */
            for (i = 0; i < count; i++) blocks.sizes[i] = 1 + check_random_int(&random, 40);
        check_product(&blocks, &random);
        check_blocks_free(&blocks);
    }
}

/* The kernels of every instruction set against plain sums, in blocks of all widths. */
static void every_instruction_set_multiplies_blocks(void **state) {
    enum { MOST = 61 };
    check_random random = check_random_seeded(4);
    int simd, rows, columns, i, j;
    (void)state;
    for (simd = DGFEM_SIMD_NONE; simd <= DGFEM_SIMD_WASM; simd++) {
        const dgfemi_kernels *kernels = dgfemi_kernels_for((dgfem_simd)simd);
        if (!kernels) continue;
        for (columns = 1; columns <= MOST; columns++) {
            dgfem_real *a, *x, *y, *z, *w, *only, *later;
            rows = 1 + check_random_int(&random, MOST);
            a = check_vector_random(&random, rows * columns);
            x = check_vector_random(&random, columns), w = check_vector_random(&random, columns);
            y = check_vector_random(&random, rows), z = check_vector_random(&random, rows);
            only = check_vector_random(&random, rows), later = check_vector_random(&random, columns);
            memset(y, 0, (size_t)rows * sizeof *y);
            memset(only, 0, (size_t)rows * sizeof *only);
            memset(w, 0, (size_t)columns * sizeof *w);
            kernels->multiply_block(a, rows, columns, x, y, z, w);
            kernels->multiply_block(a, rows, columns, x, only, NULL, NULL);
            assert_memory_equal(y, only, (size_t)rows * sizeof *y);
            for (i = 0; i < rows; i++) {
                double sum = 0;
                for (j = 0; j < columns; j++) sum += (double)a[i * columns + j] * (double)x[j];
                check_near(y[i], sum, CHECK_EPSILON * (columns + 1) * columns);
            }
            for (j = 0; j < columns; j++) {
                double sum = 0;
                for (i = 0; i < rows; i++) sum += (double)a[i * columns + j] * (double)z[i];
                check_near(w[j], sum, CHECK_EPSILON * (rows + 1) * rows);
                x[j] = later[j] + w[j]; /* the same bits whether they are added at once or later */
            }
            kernels->multiply_block(a, rows, columns, NULL, NULL, z, later);
            assert_memory_equal(x, later, (size_t)columns * sizeof *x);
            free(a);
            free(x);
            free(y);
            free(z);
            free(w);
            free(only);
            free(later);
        }
    }
}

/* ---- threads ---- */

static dgfem_matrix *shared_matrix(const check_blocks *blocks, dgfem_hooks hooks, const dgfem_matrix *like) {
    dgfem_matrix_desc desc = check_matrix_desc(blocks, 0);
    dgfem_matrix *matrix = NULL;
    desc.hooks = hooks;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_OK);
    memcpy(matrix->values, like->values, like->value_start[like->row_start[like->block_count]] * sizeof(dgfem_real));
    return matrix;
}

/* Large enough to be shared; blocks of all sizes and in an order in which nearly all couple far apart, a single row
   that meets all, one block larger than a chunk. */
static check_blocks large_blocks(int kind, check_random *random) {
    check_blocks blocks;
    if (kind == 0) return check_blocks_grid(9, 10, 11, 12);
    if (kind == 1) return check_blocks_random(random, 400, 3000);
    if (kind == 2) return check_blocks_star(300, 30);
    blocks = check_blocks_complete(40, 12);
    blocks.sizes[7] = 600;
    return blocks;
}

/* Products by any number of workers, in any ranges, are those without any, and allocate nothing. */
static void workers_change_no_bit_of_a_product(void **state) {
    static const int counts[4] = {1, 2, 3, 7};
    check_random random = check_random_seeded(6);
    int kind, k;
    (void)state;
    for (kind = 0; kind < 4; kind++) {
        check_blocks blocks = large_blocks(kind, &random);
        dgfem_matrix *alone = check_matrix_make(&blocks, 0);
        dgfem_real *x = check_vector_random(&random, alone->size), *y = check_vector_random(&random, alone->size);
        dgfem_real *z = check_vector_random(&random, alone->size);
        check_matrix_fill(alone, &random, 1.5);
        dgfem_matrix_multiply(alone, x, y);
        for (k = 0; k <= 4; k++) {
            check_host host;
            check_workers workers;
            dgfem_hooks hooks = check_hooks(&host);
            dgfem_matrix *shared;
            long calls, loops = 0;
            int round;
            workers.count = k < 4 ? counts[k] : 0, workers.loops = 0;
            hooks.parallel_for = k < 4 ? check_parallel_for : check_ragged_parallel_for;
            hooks.parallel_for_user = k < 4 ? (void *)&workers : (void *)&loops;
            shared = shared_matrix(&blocks, hooks, alone);
            calls = host.calls;
            for (round = 0; round < 2; round++) {
                memset(z, 0x55, (size_t)alone->size * sizeof *z);
                dgfem_matrix_multiply(shared, x, z);
                assert_memory_equal(y, z, (size_t)alone->size * sizeof *y);
            }
            assert_int_equal(host.calls, calls);
            assert_true(workers.loops + loops >= 2);
            dgfem_matrix_destroy(shared);
            assert_int_equal(host.live, 0);
        }
        free(x);
        free(y);
        free(z);
        dgfem_matrix_destroy(alone);
        check_blocks_free(&blocks);
    }
}

/* Sharing costs a small matrix more than it gains. */
static void small_matrices_are_not_shared(void **state) {
    check_random random = check_random_seeded(7);
    check_blocks blocks = check_blocks_grid(5, 5, 5, 12);
    dgfem_matrix *alone = check_matrix_make(&blocks, 0), *shared;
    dgfem_real *x = check_vector_random(&random, alone->size), *y = check_vector_random(&random, alone->size);
    dgfem_hooks hooks;
    long loops = 0;
    (void)state;
    memset(&hooks, 0, sizeof hooks);
    hooks.parallel_for = check_ragged_parallel_for, hooks.parallel_for_user = &loops;
    shared = shared_matrix(&blocks, hooks, alone);
    dgfem_matrix_multiply(shared, x, y);
    assert_int_equal(loops, 0);
    free(x);
    free(y);
    dgfem_matrix_destroy(alone);
    dgfem_matrix_destroy(shared);
    check_blocks_free(&blocks);
}

static void empty_matrix_is_valid(void **state) {
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_matrix *matrix = NULL;
    dgfem_real x = 1, y = 2;
    (void)state;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_OK);
    assert_int_equal(matrix->size, 0);
    dgfem_matrix_clear(matrix);
    dgfem_matrix_multiply(matrix, &x, &y);
    assert_true(y == 2);
    dgfem_matrix_destroy(matrix);
    dgfem_matrix_destroy(NULL);
}

static void bad_descriptors_are_refused(void **state) {
    int sizes[3] = {3, 2, 4}, pairs[4] = {0, 1, 2, 1};
    dgfem_vec3 centres[3];
    dgfem_matrix_desc good = dgfem_default_matrix_desc(), desc;
    dgfem_matrix *matrix = (dgfem_matrix *)sizes; /* any pointer but NULL */
    check_host host;
    (void)state;
    memset(centres, 0, sizeof centres);
    good.block_count = 3, good.block_sizes = sizes, good.pairs = pairs, good.pair_count = 2, good.centres = centres;
    good.hooks = check_hooks(&host);

    check_status(dgfem_matrix_create(NULL, &matrix), DGFEM_ERROR_DESCRIPTOR);
    assert_null(matrix);
    desc = good, desc.cookie++;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_matrix_create(&good, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "out");
    desc = good, desc.block_count = -1;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "-1 blocks");
    desc = good, desc.block_sizes = NULL;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "3 blocks");
    desc = good, desc.pairs = NULL;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "2 pairs");
    desc = good, desc.pair_count = -2;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "-2 pairs");
    desc = good, desc.pair_count = INT_MAX;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "too many");
    sizes[1] = 0;
    check_status(dgfem_matrix_create(&good, &matrix), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "block 1 has size 0");
    sizes[1] = INT_MAX;
    check_status(dgfem_matrix_create(&good, &matrix), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "block 1");
    sizes[1] = 2, pairs[2] = 3;
    check_status(dgfem_matrix_create(&good, &matrix), DGFEM_ERROR_INDEX);
    check_logged(&host, "pair 1");
    pairs[2] = 0, pairs[3] = -1;
    check_status(dgfem_matrix_create(&good, &matrix), DGFEM_ERROR_INDEX);
    check_logged(&host, "pair 1");
    pairs[3] = 1, centres[2].z = (dgfem_real)NAN;
    check_status(dgfem_matrix_create(&good, &matrix), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "block 2");
    assert_null(matrix);
    assert_int_equal(host.calls, 0);
}

/* More values than any array can hold. */
static void too_large_a_matrix_is_out_of_memory(void **state) {
    int sizes[2] = {INT_MAX / 2, INT_MAX / 2}, pairs[2] = {0, 1};
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_matrix *matrix;
    check_host host;
    (void)state;
    desc.block_count = 2, desc.block_sizes = sizes, desc.pairs = pairs, desc.pair_count = 1;
    desc.hooks = check_hooks(&host);
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_ERROR_MEMORY);
    check_logged(&host, "memory");
    assert_null(matrix);
    assert_int_equal(host.live, 0);
}

static dgfem_status create_and_destroy(void *context, const dgfem_hooks *hooks) {
    dgfem_matrix_desc desc = check_matrix_desc((const check_blocks *)context, 1);
    dgfem_matrix *matrix = NULL;
    dgfem_status status;
    desc.hooks = *hooks;
    desc.hooks.parallel_for = check_ragged_parallel_for; /* never called */
    status = dgfem_matrix_create(&desc, &matrix);
    assert_int_equal(matrix != NULL, status == DGFEM_OK);
    dgfem_matrix_destroy(matrix);
    return status;
}

static void every_allocation_may_fail(void **state) {
    check_blocks blocks = check_blocks_grid(8, 8, 8, 3), large = check_blocks_grid(8, 8, 10, 12);
    long small = check_every_allocation(create_and_destroy, &blocks);
    (void)state;
    assert_true(small >= 7);
    assert_true(check_every_allocation(create_and_destroy, &large) >= small + 8);
    check_blocks_free(&blocks);
    check_blocks_free(&large);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pattern_holds_each_pair_once_in_order),
        cmocka_unit_test(blocks_out_of_range_or_above_the_diagonal_are_absent),
        cmocka_unit_test(centres_are_copied),
        cmocka_unit_test(clear_makes_all_values_zero),
        cmocka_unit_test(product_equals_the_dense_one),
        cmocka_unit_test(every_instruction_set_multiplies_blocks),
        cmocka_unit_test(workers_change_no_bit_of_a_product),
        cmocka_unit_test(small_matrices_are_not_shared),
        cmocka_unit_test(empty_matrix_is_valid),
        cmocka_unit_test(bad_descriptors_are_refused),
        cmocka_unit_test(too_large_a_matrix_is_out_of_memory),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
