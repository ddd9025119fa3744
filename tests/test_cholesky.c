/* Sparse Cholesky: orderings, symbolic analysis, factorization and solves. */
#define DGFEM_STATIC 1 /* looks into the factor */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_matrix.h"
#include "check_threads.h"

static const dgfem_ordering all_orderings[5] = {DGFEM_ORDERING_AUTO, DGFEM_ORDERING_NATURAL,
                                                DGFEM_ORDERING_MINIMUM_DEGREE, DGFEM_ORDERING_NESTED_DISSECTION,
                                                DGFEM_ORDERING_QUICK};

static dgfem_simd instruction_set = DGFEM_SIMD_AUTO; /* that `analyse` asks for */

static dgfem_cholesky *analyse(const dgfem_matrix *matrix, dgfem_ordering ordering) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    desc.ordering = ordering;
    desc.simd = instruction_set;
    check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_OK);
    return cholesky;
}

/* ---- solutions ---- */

/* Bound for residuals: rounding errors grow like the square root of the length of the sums, which is at most that of
   the longest column of L. */
static double round_off(const dgfem_cholesky *cholesky) {
    int longest = 1, s;
    for (s = 0; s < cholesky->supernode_count; s++) {
        int length = cholesky->supernodes[s].width + cholesky->supernodes[s].height;
        if (length > longest) longest = length;
    }
    return CHECK_EPSILON * (2 + sqrt((double)longest));
}

/* Against Gaussian elimination on the dense matrix; its condition is about 5. */
static void check_against_dense(const check_blocks *blocks, check_random *random, dgfem_ordering ordering) {
    dgfem_matrix *matrix = check_matrix_make(blocks, 1);
    dgfem_cholesky *cholesky = analyse(matrix, ordering);
    dgfem_real *b = check_vector_random(random, matrix->size), *x = check_vector_random(random, matrix->size);
    double *dense, *expected;
    int i;
    check_matrix_fill(matrix, random, 1.5);
    check_status(dgfem_cholesky_factor(cholesky, matrix, NULL), DGFEM_OK);
    check_status(dgfem_cholesky_solve(cholesky, b, x), DGFEM_OK);
    dense = check_dense(matrix);
    expected = check_dense_solve(dense, matrix->size, b);
    for (i = 0; i < matrix->size; i++) check_near(x[i], expected[i], 5 * round_off(cholesky));
    check_near(check_residual(matrix, b, x), 0, round_off(cholesky));
    free(dense);
    free(expected);
    free(b);
    free(x);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
}

static void random_structures_match_the_dense_solution(void **state) {
    check_random random = check_random_seeded(1);
    int round;
    (void)state;
    for (round = 0; round < (check_long() ? 32 : 12); round++) {
        int count = 1 + check_random_int(&random, 36);
        check_blocks blocks = check_blocks_random(&random, count, check_random_int(&random, 2 * count));
        check_against_dense(&blocks, &random, all_orderings[round % 5]);
        check_blocks_free(&blocks);
    }
}

static void small_structures_match_the_dense_solution(void **state) {
    check_random random = check_random_seeded(2);
    int kind, k;
    (void)state;
    for (kind = 0; kind < 7; kind++) {
        check_blocks blocks;
        switch (kind) {
        case 0: blocks = check_blocks_make(1, 1); break;
        case 1: blocks = check_blocks_make(90, 3); break; /* nothing is coupled */
        case 2: blocks = check_blocks_chain(60, 4); break;
        case 3: blocks = check_blocks_star(70, 3); break;
        case 4: blocks = check_blocks_complete(55, 3); break;
        case 5: blocks = check_blocks_grid(5, 4, 3, 6); break;
        default: /* two grids and single blocks between them */
            blocks = check_blocks_grid(12, 5, 1, 3);
            for (k = 0; k < blocks.pair_count; k++)
                if (blocks.pairs[2 * k] % 12 == 6 || blocks.pairs[2 * k + 1] % 12 == 6)
                    blocks.pairs[2 * k] = blocks.pairs[2 * k + 1];
        }
        for (k = 0; k < 5; k++) check_against_dense(&blocks, &random, all_orderings[k]);
        check_blocks_free(&blocks);
    }
}

/* Every way in which widths and heights can miss whole strips and tiles, and sizes beyond the cache blocks. */
static void panels_of_all_sizes_match_the_dense_solution(void **state) {
    static const int large[4] = {DGFEM_PANEL_COLUMNS, DGFEM_PANEL_COLUMNS + 9, 128, 131};
    check_random random = check_random_seeded(3);
    int i, j;
    (void)state;
    for (i = 1; i <= 50; i++) { /* the strips of the widest vectors have 48 rows */
        check_blocks blocks = check_blocks_chain(3, i);
        blocks.sizes[0] = 51 - i;
        blocks.sizes[2] = 1 + i % 7;
        check_against_dense(&blocks, &random, DGFEM_ORDERING_NATURAL);
        check_blocks_free(&blocks);
    }
    for (i = check_long() ? 0 : 1; i < (check_long() ? 4 : 2); i++)
        for (j = check_long() ? 0 : 1; j < 4; j += check_long() ? 1 : 4) {
            check_blocks blocks = check_blocks_chain(2, large[i]);
            blocks.sizes[1] = large[(i + j) % 4];
            check_against_dense(&blocks, &random, DGFEM_ORDERING_NATURAL);
            check_blocks_free(&blocks);
        }
}

/* The same on every path through the kernels that this machine has. */
static void every_instruction_set_matches_the_dense_solution(void **state) {
    static const char *const names[] = {"best", "none", "SSE2", "AVX2", "AVX-512", "NEON", "wasm"};
    int found = 0, simd;
    for (simd = DGFEM_SIMD_NONE; simd <= DGFEM_SIMD_WASM; simd++) {
        if (!dgfemi_kernels_for((dgfem_simd)simd)) continue;
        print_message("instruction set: %s\n", names[simd]);
        instruction_set = (dgfem_simd)simd;
        random_structures_match_the_dense_solution(state);
        small_structures_match_the_dense_solution(state);
        panels_of_all_sizes_match_the_dense_solution(state);
        found++;
    }
    instruction_set = DGFEM_SIMD_AUTO;
    assert_true(found >= 1);
}

static void instruction_sets_are_chosen_and_reported(void **state) {
    check_blocks blocks = check_blocks_chain(2, 3);
    check_random random = check_random_seeded(14);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 0);
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    dgfem_cholesky_info info;
    check_host host;
    int simd, best = DGFEM_SIMD_NONE;
    (void)state;
    check_matrix_fill(matrix, &random, 1.5);
    desc.hooks = check_hooks(&host);
    for (simd = DGFEM_SIMD_WASM + 1; simd >= -1; simd--) {
        desc.simd = (dgfem_simd)simd;
        if (simd != DGFEM_SIMD_AUTO && !dgfemi_kernels_for((dgfem_simd)simd)) {
            check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_ERROR_ARGUMENT);
            check_logged(&host, "instruction set");
            assert_null(cholesky);
            continue;
        }
        check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_OK);
        check_status(dgfem_cholesky_factor(cholesky, matrix, &info), DGFEM_OK);
        if (simd == DGFEM_SIMD_AUTO) assert_int_equal(info.simd, best);
        else assert_int_equal(info.simd, simd);
        if (simd > best) best = simd;
        dgfem_cholesky_destroy(cholesky);
    }
    assert_int_equal(host.live, 0);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

/* Solves a large system and looks at its residual alone. */
static void check_large(const check_blocks *blocks, check_random *random, dgfem_ordering ordering) {
    dgfem_matrix *matrix = check_matrix_make(blocks, 1);
    dgfem_cholesky *cholesky = analyse(matrix, ordering);
    dgfem_real *b = check_vector_random(random, matrix->size);
    dgfem_real *x = check_vector_random(random, matrix->size);
    check_matrix_fill(matrix, random, 1.01);
    check_status(dgfem_cholesky_factor(cholesky, matrix, NULL), DGFEM_OK);
    check_status(dgfem_cholesky_solve(cholesky, b, x), DGFEM_OK);
    check_near(check_residual(matrix, b, x), 0, round_off(cholesky));
    memcpy(x, b, (size_t)matrix->size * sizeof *x); /* in place */
    check_status(dgfem_cholesky_solve(cholesky, x, x), DGFEM_OK);
    check_near(check_residual(matrix, b, x), 0, round_off(cholesky));
    free(b);
    free(x);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
}

static void grids_of_hexahedra_leave_residuals_of_round_off(void **state) {
    check_random random = check_random_seeded(4);
    check_blocks grid = check_blocks_grid(7, 6, 5, 12), fine = check_blocks_grid(12, 11, 10, 3);
    int k;
    (void)state;
    for (k = 0; k < 4; k++) {
        if (all_orderings[k] == DGFEM_ORDERING_NATURAL) continue;
        check_large(&grid, &random, all_orderings[k]);
        check_large(&fine, &random, all_orderings[k]);
    }
    check_blocks_free(&grid);
    check_blocks_free(&fine);
}

/* A tree as deep as the chain is long, and a row as dense as the star is large: nothing may recurse or take the square
   of the time. */
static void long_chains_and_large_stars_are_solved(void **state) {
    check_random random = check_random_seeded(5);
    const int part = DGFEM_REAL_IS_FLOAT && !check_long() ? 5 : 1; /* sanitizers are slow; they need not see all */
    check_blocks chain = check_blocks_chain(100000 / part, 3), star = check_blocks_star(30000 / part, 3);
    check_blocks loose = check_blocks_make(30000 / part, 2);
    int i;
    (void)state;
    check_large(&chain, &random, DGFEM_ORDERING_NATURAL);
    check_large(&chain, &random, DGFEM_ORDERING_AUTO);
    check_large(&star, &random, DGFEM_ORDERING_AUTO);
    for (i = 0; i < loose.count; i++) loose.centres[i] = loose.centres[0];
    check_large(&loose, &random, DGFEM_ORDERING_AUTO);
    check_blocks_free(&chain);
    check_blocks_free(&star);
    check_blocks_free(&loose);
}

/* ---- orderings ---- */

typedef struct order_result {
    double entries, flops;
} order_result;

/* The order is a permutation; counts the columns of L, by the elimination tree. */
static order_result check_order(const check_blocks *blocks, dgfem_ordering ordering) {
    dgfem_matrix *matrix = check_matrix_make(blocks, 1);
    dgfem_cholesky *cholesky = analyse(matrix, ordering);
    unsigned char *seen = (unsigned char *)calloc((size_t)blocks->count + 1, 1);
    order_result result;
    int k;
    assert_non_null(seen);
    for (k = 0; k < blocks->count; k++) {
        int block = cholesky->order[k];
        assert_in_range(block, 0, blocks->count - 1);
        assert_false(seen[block]);
        seen[block] = 1;
        assert_int_equal(cholesky->offset[k + 1] - cholesky->offset[k], blocks->sizes[block]);
        assert_int_equal(cholesky->source[k], matrix->offset[block]);
    }
    result.entries = cholesky->factor_entries;
    result.flops = cholesky->factor_flops;
    free(seen);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
    return result;
}

static void orders_are_permutations(void **state) {
    check_random random = check_random_seeded(6);
    int round, i;
    (void)state;
    for (round = 0; round < 60; round++) {
        int count = 1 + check_random_int(&random, 400);
        check_blocks blocks = check_blocks_random(&random, count, check_random_int(&random, 3 * count));
        switch (round % 6) { /* centres that say little or nothing */
        case 0:
            for (i = 0; i < count; i++) blocks.centres[i] = blocks.centres[0];
            break;
        case 1:
            for (i = 0; i < count; i++) blocks.centres[i] = blocks.centres[i % 3];
            break;
        case 2:
            for (i = 0; i < count; i++) blocks.centres[i].x *= (dgfem_real)(DGFEM_REAL_IS_FLOAT ? 3e38 : 1e308);
            break;
        case 3:
            for (i = 0; i < count; i++) blocks.centres[i].y *= (dgfem_real)1e-30;
            break;
        default: break;
        }
        for (i = 0; i < 5; i++) check_order(&blocks, all_orderings[i]);
        check_blocks_free(&blocks);
    }
}

/* The counts that the analysis gets from the tree, by eliminating unknown after unknown in a dense table. */
static void counted_work_is_that_of_dense_elimination(void **state) {
    check_random random = check_random_seeded(7);
    int round, r, k, i, j, c;
    (void)state;
    for (round = 0; round < 12; round++) {
        int count = 2 + check_random_int(&random, 30);
        check_blocks blocks = check_blocks_random(&random, count, check_random_int(&random, 2 * count));
        dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
        dgfem_cholesky *cholesky = analyse(matrix, all_orderings[round % 5]);
        int n = matrix->size;
        unsigned char *filled = (unsigned char *)calloc((size_t)(n * n), 1);
        int *place = (int *)calloc((size_t)n, sizeof(int));
        double entries = 0, flops = 0;
        assert_true(filled && place);
        for (k = 0; k < count; k++)
            for (i = cholesky->offset[k]; i < cholesky->offset[k + 1]; i++)
                place[cholesky->source[k] + i - cholesky->offset[k]] = i;
        for (r = 0; r < count; r++)
            for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++)
                for (i = matrix->offset[r]; i < matrix->offset[r + 1]; i++)
                    for (j = matrix->offset[matrix->column[k]]; j < matrix->offset[matrix->column[k] + 1]; j++)
                        filled[place[i] * n + place[j]] = filled[place[j] * n + place[i]] = 1;
        for (c = 0; c < n; c++) {
            double length = 1;
            for (i = c + 1; i < n; i++) {
                if (!filled[i * n + c]) continue;
                length++;
                for (j = c + 1; j < n; j++) filled[i * n + j] |= filled[j * n + c];
            }
            entries += length;
            flops += length * length;
        }
        assert_true(entries == cholesky->factor_entries);
        assert_true(flops == cholesky->factor_flops);
        free(filled);
        free(place);
        dgfem_cholesky_destroy(cholesky);
        dgfem_matrix_destroy(matrix);
        check_blocks_free(&blocks);
    }
}

/* A grid of 10^3 hexahedra with 12 unknowns each. */
static void dissection_needs_least_work_on_a_grid(void **state) {
    check_blocks blocks = check_blocks_grid(10, 10, 10, 12);
    double natural = check_order(&blocks, DGFEM_ORDERING_NATURAL).flops;
    double degree = check_order(&blocks, DGFEM_ORDERING_MINIMUM_DEGREE).flops;
    double dissection = check_order(&blocks, DGFEM_ORDERING_NESTED_DISSECTION).flops;
    double best = check_order(&blocks, DGFEM_ORDERING_AUTO).flops;
    int i;
    (void)state;
    print_message("GFLOP: natural %.3f, minimum degree %.3f, dissection %.3f\n", 1e-9 * natural, 1e-9 * degree,
                  1e-9 * dissection);
    assert_true(degree < natural / 2);
    assert_true(dissection < 0.7 * degree);
    assert_true(dissection < 2.6e9);
    assert_true(best == dissection);
    /* flat cells and a place far away make no difference */
    for (i = 0; i < blocks.count; i++) {
        blocks.centres[i].x = blocks.centres[i].x * 64 + 1024;
        blocks.centres[i].z /= 32;
    }
    assert_true(check_order(&blocks, DGFEM_ORDERING_NESTED_DISSECTION).flops == dissection);
    check_blocks_free(&blocks);
}

/* Centres moved at random by up to half a cell, and blocks left out: no plane cuts along a layer any more. */
static void dissection_narrows_rough_separators(void **state) {
    check_random random = check_random_seeded(8);
    check_blocks grid = check_blocks_grid(12, 12, 12, 12);
    double smooth = check_order(&grid, DGFEM_ORDERING_NESTED_DISSECTION).flops, rough;
    int i;
    (void)state;
    for (i = 0; i < grid.count; i++) {
        dgfem_vec3 move = check_random_vec3(&random, -0.3, 0.3);
        grid.centres[i].x += move.x, grid.centres[i].y += move.y, grid.centres[i].z += move.z;
    }
    rough = check_order(&grid, DGFEM_ORDERING_NESTED_DISSECTION).flops;
    print_message("GFLOP: smooth %.3f, rough %.3f\n", 1e-9 * smooth, 1e-9 * rough);
    assert_true(rough < 1.1 * smooth);
    check_blocks_free(&grid);
}

/* Centres that do not fit the couplings make dissection bad: the automatic choice is minimum degree then. */
static void automatic_choice_takes_what_needs_less_work(void **state) {
    check_random random = check_random_seeded(9);
    check_blocks blocks = check_blocks_grid(40, 40, 1, 3);
    double degree, dissection, best;
    int i;
    (void)state;
    for (i = 0; i < blocks.count; i++) blocks.centres[i] = check_random_vec3(&random, -1, 1);
    degree = check_order(&blocks, DGFEM_ORDERING_MINIMUM_DEGREE).flops;
    dissection = check_order(&blocks, DGFEM_ORDERING_NESTED_DISSECTION).flops;
    best = check_order(&blocks, DGFEM_ORDERING_AUTO).flops;
    assert_true(degree < dissection);
    assert_true(best == degree);
    check_blocks_free(&blocks);
}

/* Nodes of three unknowns, all those of a cell of 2^dimension nodes coupled, as in conforming elements; `pieces` of it
   that nothing couples. */
static check_blocks node_mesh(int wide, int dimension, int pieces) {
    int high = dimension == 3 ? wide : 1, count = wide * wide * high, piece, i, k, m;
    check_blocks blocks = check_blocks_make(pieces * count, 3);
    for (piece = 0; piece < pieces; piece++)
        for (i = 0; i < count; i++) {
            int x = i % wide, y = i / wide % wide, z = i / (wide * wide), corner[8];
            dgfem_vec3 *centre = blocks.centres + piece * count + i;
            centre->x = (dgfem_real)(x + piece * (wide / 2)), centre->y = (dgfem_real)y, centre->z = (dgfem_real)z;
            if (x + 1 == wide || y + 1 == wide || (dimension == 3 && z + 1 == wide)) continue;
            for (k = 0; k < 1 << dimension; k++)
                corner[k] = piece * count + i + k % 2 + k / 2 % 2 * wide + k / 4 * wide * wide;
            for (k = 0; k < 1 << dimension; k++)
                for (m = 0; m < k; m++) check_blocks_couple(&blocks, corner[k], corner[m]);
        }
    return blocks;
}

static void check_same_order_twice(const check_blocks *blocks, dgfem_ordering ordering) {
    dgfem_matrix *matrix = check_matrix_make(blocks, 1);
    dgfem_cholesky *first = analyse(matrix, ordering), *second = analyse(matrix, ordering);
    assert_memory_equal(first->order, second->order, (size_t)blocks->count * sizeof(int));
    dgfem_cholesky_destroy(first);
    dgfem_cholesky_destroy(second);
    dgfem_matrix_destroy(matrix);
}

/* As shells and conforming solids have them: also in pieces that overlap, and with a node that all others are coupled
   to. */
static void dissection_suits_meshes_of_nodes(void **state) {
    int kind;
    (void)state;
    for (kind = 0; kind < 4; kind++) {
        int dimension = kind % 2 + 2, pieces = kind < 2 ? 1 : 2, i;
        check_blocks blocks = node_mesh(dimension == 2 ? 60 : 14, dimension, pieces);
        double degree = check_order(&blocks, DGFEM_ORDERING_MINIMUM_DEGREE).flops;
        double dissection = check_order(&blocks, DGFEM_ORDERING_NESTED_DISSECTION).flops, dense;
        print_message("GFLOP: minimum degree %.4f, dissection %.4f\n", 1e-9 * degree, 1e-9 * dissection);
        assert_true(dissection < (kind == 1 ? 0.6 : 0.9) * degree);
        check_same_order_twice(&blocks, DGFEM_ORDERING_NESTED_DISSECTION);
        check_same_order_twice(&blocks, DGFEM_ORDERING_AUTO);
        for (i = 0; i + 1 < blocks.count; i++) check_blocks_couple(&blocks, blocks.count - 1, i);
        dense = check_order(&blocks, DGFEM_ORDERING_AUTO).flops;
        assert_true(dense < 1.3 * dissection);
        check_blocks_free(&blocks);
    }
}

/* Where a factorization is little work dissection is not tried; where it is much it is. */
static void quick_choice_tries_dissection_of_large_grids_only(void **state) {
    check_blocks small = check_blocks_grid(6, 6, 6, 12), large = check_blocks_grid(10, 10, 10, 12);
    double small_degree = check_order(&small, DGFEM_ORDERING_MINIMUM_DEGREE).flops;
    (void)state;
    assert_true(check_order(&small, DGFEM_ORDERING_NESTED_DISSECTION).flops < small_degree);
    assert_true(check_order(&small, DGFEM_ORDERING_QUICK).flops == small_degree);
    assert_true(check_order(&large, DGFEM_ORDERING_QUICK).flops == check_order(&large, DGFEM_ORDERING_AUTO).flops);
    assert_true(check_order(&large, DGFEM_ORDERING_QUICK).flops <
                check_order(&large, DGFEM_ORDERING_MINIMUM_DEGREE).flops);
    check_blocks_free(&small);
    check_blocks_free(&large);
}

/* Trees have orders without fill, and minimum degree finds them. */
static void minimum_degree_makes_no_fill_in_trees(void **state) {
    check_random random = check_random_seeded(10);
    int kind, i;
    (void)state;
    for (kind = 0; kind < 3; kind++) {
        check_blocks blocks = kind == 0   ? check_blocks_chain(300, 3)
                              : kind == 1 ? check_blocks_star(300, 3)
                                          : check_blocks_make(300, 3);
        for (i = 1; kind == 2 && i < blocks.count; i++) check_blocks_couple(&blocks, i, check_random_int(&random, i));
        /* 300 lower triangles of 3 x 3 and a whole block for each of the 299 edges */
        assert_true(check_order(&blocks, DGFEM_ORDERING_MINIMUM_DEGREE).entries == 300 * 6 + 299 * 9);
        check_blocks_free(&blocks);
    }
}

/* ---- failures ---- */

/* Blocks of 2 x 2 with [4 1; 1 4] on the diagonal and 0.5 wherever blocks are coupled. */
static void fill_simply(dgfem_matrix *matrix) {
    int r, k;
    for (k = 0; k < (int)matrix->value_start[matrix->row_start[matrix->block_count]]; k++) matrix->values[k] = 0.5;
    for (r = 0; r < matrix->block_count; r++) {
        dgfem_real *block = dgfem_matrix_block(matrix, r, r);
        block[0] = block[3] = 4;
        block[1] = block[2] = 1;
    }
}

/* A block made negative fails itself, wherever in the order it stands: before it all minors are positive. */
static void failed_pivots_name_their_block(void **state) {
    check_blocks blocks = check_blocks_grid(4, 4, 1, 2);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    dgfem_cholesky_info info;
    dgfem_real *b, *x;
    check_host host;
    check_random random = check_random_seeded(11);
    int k, bad;
    (void)state;
    b = check_vector_random(&random, matrix->size);
    x = check_vector_random(&random, matrix->size);
    desc.hooks = check_hooks(&host);
    check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_OK);
    for (bad = 0; bad < blocks.count; bad++)
        for (k = 0; k < 4; k++) {
            char name[32];
            fill_simply(matrix);
            if (k == 0) dgfem_matrix_block(matrix, bad, bad)[0] = -4;
            if (k == 1) dgfem_matrix_block(matrix, bad, bad)[3] = (dgfem_real)NAN;
            if (k == 2) dgfem_matrix_block(matrix, bad, bad)[3] = (dgfem_real)INFINITY;
            if (k == 3) dgfem_matrix_block(matrix, bad, bad)[3] = 0;
            check_status(dgfem_cholesky_factor(cholesky, matrix, &info), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
            assert_int_equal(info.failed_block, bad);
            snprintf(name, sizeof name, "block %d", bad);
            check_logged(&host, name);
            check_status(dgfem_cholesky_solve(cholesky, b, x), DGFEM_ERROR_ARGUMENT);
            check_logged(&host, "no factorization");
        }
    fill_simply(matrix);
    check_status(dgfem_cholesky_factor(cholesky, matrix, &info), DGFEM_OK);
    assert_int_equal(info.failed_block, DGFEM_NONE);
    check_status(dgfem_cholesky_solve(cholesky, b, x), DGFEM_OK);
    check_near(check_residual(matrix, b, x), 0, round_off(cholesky));
    free(b);
    free(x);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

/* A 2 x 2 matrix [1 1; 1 1 + d]: its second pivot is d. */
static dgfem_status factor_with_pivot(double pivot) {
    check_blocks blocks = check_blocks_chain(2, 1);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 0);
    dgfem_cholesky *cholesky = analyse(matrix, DGFEM_ORDERING_NATURAL);
    dgfem_status status;
    matrix->values[0] = matrix->values[1] = 1;
    matrix->values[2] = (dgfem_real)(1 + pivot);
    status = dgfem_cholesky_factor(cholesky, matrix, NULL);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
    return status;
}

static void pivots_without_a_correct_digit_fail(void **state) {
    (void)state;
    check_status(factor_with_pivot(-4 * CHECK_EPSILON), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
    check_status(factor_with_pivot(0), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
    check_status(factor_with_pivot(4 * CHECK_EPSILON), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
    check_status(factor_with_pivot(12 * CHECK_EPSILON), DGFEM_OK);
}

/* A and the same numbers a hundred orders of magnitude away. */
static void scale_of_the_numbers_does_not_matter(void **state) {
    static const double scales[2] = {DGFEM_REAL_IS_FLOAT ? 1e-25 : 1e-200, DGFEM_REAL_IS_FLOAT ? 1e25 : 1e200};
    check_random random = check_random_seeded(12);
    check_blocks blocks = check_blocks_grid(4, 4, 4, 5);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
    dgfem_cholesky *cholesky = analyse(matrix, DGFEM_ORDERING_AUTO);
    dgfem_real *b = check_vector_random(&random, matrix->size), *x = check_vector_random(&random, matrix->size);
    int k, i;
    (void)state;
    for (k = 0; k < 2; k++) {
        check_matrix_fill(matrix, &random, 1.5);
        for (i = 0; i < (int)matrix->value_start[matrix->row_start[64]]; i++)
            matrix->values[i] = (dgfem_real)((double)matrix->values[i] * scales[k]);
        check_status(dgfem_cholesky_factor(cholesky, matrix, NULL), DGFEM_OK);
        check_status(dgfem_cholesky_solve(cholesky, b, x), DGFEM_OK);
        check_near(check_residual(matrix, b, x), 0, round_off(cholesky));
    }
    free(b);
    free(x);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

static void other_patterns_are_refused(void **state) {
    check_blocks blocks = check_blocks_chain(6, 2), others[4];
    dgfem_matrix *matrix = check_matrix_make(&blocks, 0);
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    check_host host;
    int k;
    (void)state;
    desc.hooks = check_hooks(&host);
    check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_OK);
    others[0] = check_blocks_chain(7, 2); /* one more */
    others[1] = check_blocks_chain(6, 2); /* another pair */
    others[1].pairs[0] = 2;
    others[2] = check_blocks_chain(6, 2); /* other sizes of the same sum */
    others[2].sizes[3] = 1, others[2].sizes[4] = 3;
    others[3] = check_blocks_make(6, 2); /* no pairs */
    for (k = 0; k < 4; k++) {
        dgfem_matrix *other = check_matrix_make(&others[k], 0);
        fill_simply(matrix);
        check_status(dgfem_cholesky_factor(cholesky, other, NULL), DGFEM_ERROR_ARGUMENT);
        check_logged(&host, "pattern");
        dgfem_matrix_destroy(other);
        check_blocks_free(&others[k]);
    }
    check_status(dgfem_cholesky_factor(cholesky, matrix, NULL), DGFEM_OK);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

static void bad_arguments_are_refused(void **state) {
    check_blocks blocks = check_blocks_chain(3, 2);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 0);
    dgfem_cholesky_desc good = dgfem_default_cholesky_desc(), desc;
    dgfem_cholesky *cholesky = (dgfem_cholesky *)&blocks; /* any pointer but NULL */
    dgfem_cholesky_info info;
    dgfem_real b[6] = {1, 2, 3, 4, 5, 6}, x[6] = {7, 7, 7, 7, 7, 7};
    check_host host;
    (void)state;
    good.hooks = check_hooks(&host);
    fill_simply(matrix);
    check_status(dgfem_cholesky_create(matrix, NULL, &cholesky), DGFEM_ERROR_DESCRIPTOR);
    assert_null(cholesky);
    desc = good, desc.cookie = 0;
    check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_cholesky_create(NULL, &good, &cholesky), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    check_status(dgfem_cholesky_create(matrix, &good, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    desc = good, desc.ordering = (dgfem_ordering)99;
    check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "ordering 99");
    desc = good, desc.ordering = DGFEM_ORDERING_NESTED_DISSECTION;
    check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "centres");
    assert_null(cholesky);
    check_status(dgfem_cholesky_factor(NULL, matrix, &info), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_cholesky_solve(NULL, b, x), DGFEM_ERROR_ARGUMENT);

    check_status(dgfem_cholesky_create(matrix, &good, &cholesky), DGFEM_OK);
    check_status(dgfem_cholesky_solve(cholesky, b, x), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no factorization");
    check_status(dgfem_cholesky_factor(cholesky, NULL, &info), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    check_status(dgfem_cholesky_factor(cholesky, matrix, &info), DGFEM_OK);
    check_status(dgfem_cholesky_solve(cholesky, NULL, x), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    check_status(dgfem_cholesky_solve(cholesky, b, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    b[4] = (dgfem_real)INFINITY;
    check_status(dgfem_cholesky_solve(cholesky, b, x), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "b[4]");
    assert_true(x[0] == 7 && x[5] == 7);
    dgfem_cholesky_destroy(cholesky);
    dgfem_cholesky_destroy(NULL);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
    assert_int_equal(host.live, 0);
}

/* ---- memory and repeatability ---- */

static void empty_system_is_solved(void **state) {
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_matrix *matrix = NULL;
    dgfem_cholesky *cholesky;
    dgfem_cholesky_info info;
    dgfem_real x = 3;
    (void)state;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_OK);
    cholesky = analyse(matrix, DGFEM_ORDERING_AUTO);
    check_status(dgfem_cholesky_factor(cholesky, matrix, &info), DGFEM_OK);
    assert_int_equal(info.supernodes, 0);
    assert_true(info.factor_flops == 0);
    check_status(dgfem_cholesky_solve(cholesky, &x, &x), DGFEM_OK);
    assert_true(x == 3);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
}

static dgfem_status create_and_destroy(void *context, const dgfem_hooks *hooks) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    dgfem_status status;
    desc.hooks = *hooks;
    status = dgfem_cholesky_create((const dgfem_matrix *)context, &desc, &cholesky);
    assert_int_equal(cholesky != NULL, status == DGFEM_OK);
    dgfem_cholesky_destroy(cholesky);
    return status;
}

static void every_allocation_may_fail(void **state) {
    check_blocks blocks = check_blocks_grid(6, 6, 6, 12);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
    (void)state;
    assert_true(check_every_allocation(create_and_destroy, matrix) > 13);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

/* Fronts may run at the same time if both are in tasks, not in the same one; otherwise in ascending order, tasks first. */
static int is_before(const dgfem_cholesky *c, int s, int t) {
    int task[2];
    task[0] = c->supernodes[s].task, task[1] = c->supernodes[t].task;
    if (task[0] != task[1]) return task[0] != DGFEM_NONE && task[1] == DGFEM_NONE;
    return s < t;
}

static int is_apart(size_t a, size_t a_size, size_t b, size_t b_size) { return a + a_size <= b || b + b_size <= a; }

/* However the fronts are distributed: no panel and no update is made where an update still waits for its parent, or where
   a panel is. With one thread the room for all is little more than L. */
static void updates_share_little_memory(void **state) {
    check_blocks blocks = check_blocks_grid(10, 10, 10, 12);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    check_workers workers;
    int threads;
    (void)state;
    workers.count = 2, workers.loops = 0;
    for (threads = 0; threads < 2; threads++) {
        dgfem_cholesky *c = NULL;
        double kept;
        int s, t;
        desc.hooks.parallel_for = threads ? check_parallel_for : NULL;
        desc.hooks.parallel_for_user = &workers;
        desc.simd = DGFEM_SIMD_NONE;
        check_status(dgfem_cholesky_create(matrix, &desc, &c), DGFEM_OK);
        for (s = 0; s < c->supernode_count; s++)
            for (t = 0; t < c->supernode_count; t++) {
                const dgfemi_supernode *a = c->supernodes + s, *b = c->supernodes + t;
                size_t a_panel = dgfemi_panel_size(c, a), b_panel = dgfemi_panel_size(c, b);
                size_t a_update = dgfemi_update_size(c, a), b_update = dgfemi_update_size(c, b);
                if (s != t) assert_true(is_apart(a->values, a_panel, b->values, b_panel));
                if (a->parent == DGFEM_NONE) continue;
                assert_true(c->values + a->update + a_update <= c->own);
                if (is_before(c, a->parent, t)) continue; /* a's update has been dropped by then */
                if (b->parent != DGFEM_NONE && s != t && !is_before(c, b->parent, s))
                    assert_true(is_apart(a->update, a_update, b->update, b_update));
                /* b's panel is there when a's update is made, or is made while that waits */
                assert_true(is_apart(a->update, a_update, b->values, b_panel));
            }
        kept = (double)(c->own - c->values) / c->factor_entries;
        print_message("%d supernodes in %d tasks: %.2f times the size of L\n", c->supernode_count, c->task_count, kept);
        if (!threads) assert_true(kept < 1.6); /* tasks share little */
        dgfem_cholesky_destroy(c);
    }
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

/* Factorizations and solves allocate nothing, and what they give depends on nothing but the numbers. */
static void repeated_factorizations_give_the_same_bits(void **state) {
    check_random random = check_random_seeded(13);
    check_blocks blocks = check_blocks_grid(6, 5, 4, 7);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 1), *other = check_matrix_make(&blocks, 1);
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *first = NULL, *second = analyse(matrix, DGFEM_ORDERING_AUTO);
    dgfem_real *b = check_vector_random(&random, matrix->size);
    dgfem_real *x = check_vector_random(&random, matrix->size), *y = check_vector_random(&random, matrix->size);
    check_host host;
    long calls;
    (void)state;
    check_matrix_fill(matrix, &random, 1.5);
    check_matrix_fill(other, &random, 2.5);
    desc.hooks = check_hooks(&host);
    check_status(dgfem_cholesky_create(matrix, &desc, &first), DGFEM_OK);
    calls = host.calls;
    check_status(dgfem_cholesky_factor(first, other, NULL), DGFEM_OK); /* must leave no trace */
    check_status(dgfem_cholesky_factor(first, matrix, NULL), DGFEM_OK);
    check_status(dgfem_cholesky_solve(first, b, x), DGFEM_OK);
    assert_int_equal(host.calls, calls);
    check_status(dgfem_cholesky_factor(second, matrix, NULL), DGFEM_OK);
    check_status(dgfem_cholesky_solve(second, b, y), DGFEM_OK);
    assert_memory_equal(x, y, (size_t)matrix->size * sizeof *x);
    free(b);
    free(x);
    free(y);
    dgfem_cholesky_destroy(first);
    dgfem_cholesky_destroy(second);
    dgfem_matrix_destroy(matrix);
    dgfem_matrix_destroy(other);
    check_blocks_free(&blocks);
}

/* Each solution has the bits of a solve of its own, whatever stands beside it; b and x may be the same. */
static void many_right_hand_sides_are_solved_as_one(void **state) {
    enum { MOST = 11 };
    check_random random = check_random_seeded(15);
    check_blocks blocks = check_blocks_random(&random, 30, 70);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
    dgfem_cholesky *cholesky = analyse(matrix, DGFEM_ORDERING_AUTO);
    int n = matrix->size, count, k;
    dgfem_real *b = check_vector_random(&random, MOST * n), *x = check_vector_random(&random, MOST * n);
    dgfem_real *one = check_vector_random(&random, n);
    (void)state;
    check_matrix_fill(matrix, &random, 1.5);
    check_status(dgfem_cholesky_solve_many(cholesky, 1, b, x), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_cholesky_factor(cholesky, matrix, NULL), DGFEM_OK);
    for (count = 0; count <= MOST; count++) {
        memcpy(x, b, MOST * (size_t)n * sizeof *x);
        check_status(dgfem_cholesky_solve_many(cholesky, count, x, x), DGFEM_OK);
        for (k = 0; k < MOST; k++) {
            if (k < count) check_status(dgfem_cholesky_solve(cholesky, b + k * n, one), DGFEM_OK);
            else memcpy(one, b + k * n, (size_t)n * sizeof *one);
            assert_memory_equal(x + k * n, one, (size_t)n * sizeof *one);
        }
    }
    check_status(dgfem_cholesky_solve_many(cholesky, -1, b, x), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_cholesky_solve_many(NULL, 1, b, x), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_cholesky_solve_many(cholesky, 1, NULL, x), DGFEM_ERROR_ARGUMENT);
    memcpy(x, b, MOST * (size_t)n * sizeof *x);
    b[3 * n + 5] = (dgfem_real)NAN;
    check_status(dgfem_cholesky_solve_many(cholesky, MOST, b, x), DGFEM_ERROR_NOT_FINITE);
    assert_memory_equal(x, b, 3 * (size_t)n * sizeof *x);
    free(b);
    free(x);
    free(one);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

/* Of systems that make many tasks and fronts that are shared; without threads, and with 1, 2, 3 and 7. */
static void workers_change_no_bit(void **state) {
    static const int counts[4] = {1, 2, 3, 7};
    check_random random = check_random_seeded(16);
    int kind, k;
    (void)state;
    for (kind = 0; kind < 3; kind++) {
        check_blocks blocks = kind == 0   ? check_blocks_grid(6, 6, 7, 12)
                              : kind == 1 ? check_blocks_grid(30, 29, 1, 12)
                                          : check_blocks_random(&random, 150, 300);
        dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
        dgfem_cholesky *alone = analyse(matrix, DGFEM_ORDERING_AUTO);
        dgfem_real *b = check_vector_random(&random, matrix->size);
        dgfem_real *x = check_vector_random(&random, matrix->size), *y = check_vector_random(&random, matrix->size);
        check_matrix_fill(matrix, &random, 1.5);
        check_status(dgfem_cholesky_factor(alone, matrix, NULL), DGFEM_OK);
        check_status(dgfem_cholesky_solve(alone, b, x), DGFEM_OK);
        for (k = 0; k < 4; k += DGFEM_REAL_IS_FLOAT && !check_long() ? 2 : 1) {
            dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
            dgfem_cholesky *shared = NULL;
            check_workers workers;
            check_host host;
            long calls;
            workers.count = counts[k], workers.loops = 0;
            desc.hooks = check_hooks(&host);
            desc.hooks.parallel_for = check_parallel_for;
            desc.hooks.parallel_for_user = &workers;
            check_status(dgfem_cholesky_create(matrix, &desc, &shared), DGFEM_OK);
            calls = host.calls;
            check_status(dgfem_cholesky_factor(shared, matrix, NULL), DGFEM_OK);
            check_status(dgfem_cholesky_solve(shared, b, y), DGFEM_OK);
            assert_int_equal(host.calls, calls);
            assert_true(workers.loops >= (kind == 0 ? 4 : 1));
            assert_memory_equal(x, y, (size_t)matrix->size * sizeof *x);
            dgfem_cholesky_destroy(shared);
        }
        free(b);
        free(x);
        free(y);
        dgfem_cholesky_destroy(alone);
        dgfem_matrix_destroy(matrix);
        check_blocks_free(&blocks);
    }
}

/* Of two bad blocks the one that is eliminated first is named, by any number of workers. */
static void workers_name_the_same_failed_block(void **state) {
    check_random random = check_random_seeded(17);
    check_blocks blocks = check_blocks_grid(6, 6, 6, 12);
    dgfem_matrix *matrix = check_matrix_make(&blocks, 1);
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    dgfem_cholesky_info info;
    check_workers workers;
    int round, i;
    (void)state;
    workers.loops = 0;
    desc.hooks.parallel_for = check_parallel_for;
    desc.hooks.parallel_for_user = &workers;
    check_status(dgfem_cholesky_create(matrix, &desc, &cholesky), DGFEM_OK);
    check_matrix_fill(matrix, &random, 1.5);
    for (round = 0; round < 6; round++) {
        int bad[2], first = DGFEM_NONE;
        dgfem_real kept[2];
        workers.count = 1 + round;
        for (i = 0; i < 2; i++) {
            dgfem_real *block;
            bad[i] = (i * 108 + check_random_int(&random, 108));
            block = dgfem_matrix_block(matrix, bad[i], bad[i]);
            kept[i] = *block;
            *block = i ? -1 : (dgfem_real)NAN;
        }
        for (i = 0; i < blocks.count && first == DGFEM_NONE; i++)
            if (cholesky->order[i] == bad[0] || cholesky->order[i] == bad[1]) first = cholesky->order[i];
        check_status(dgfem_cholesky_factor(cholesky, matrix, &info), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
        /* tasks come before what is above them, whatever stands between them in the order */
        assert_true(info.failed_block == first || info.failed_block == bad[0] || info.failed_block == bad[1]);
        workers.count = 1;
        i = info.failed_block;
        check_status(dgfem_cholesky_factor(cholesky, matrix, &info), DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
        assert_int_equal(info.failed_block, i);
        for (i = 0; i < 2; i++) *dgfem_matrix_block(matrix, bad[i], bad[i]) = kept[i];
    }
    check_status(dgfem_cholesky_factor(cholesky, matrix, &info), DGFEM_OK);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(matrix);
    check_blocks_free(&blocks);
}

/* Two pieces that nothing couples, one block coupled to all of one piece. */
static void disconnected_graphs_and_dense_rows_are_solved(void **state) {
    check_random random = check_random_seeded(18);
    check_blocks blocks = check_blocks_grid(12, 5, 4, 3);
    int i, simd;
    (void)state;
    for (i = 0; i < blocks.pair_count; i++)
        if (blocks.pairs[2 * i] / 60 != blocks.pairs[2 * i + 1] / 60 && blocks.pairs[2 * i] / 120 != blocks.pairs[2 * i + 1] / 120)
            blocks.pairs[2 * i] = blocks.pairs[2 * i + 1];
    for (i = 0; i < 120; i++) check_blocks_couple(&blocks, 7, i);
    for (simd = DGFEM_SIMD_NONE; simd <= DGFEM_SIMD_WASM; simd++) {
        if (!dgfemi_kernels_for((dgfem_simd)simd)) continue;
        instruction_set = (dgfem_simd)simd;
        for (i = 0; i < 4; i++) check_large(&blocks, &random, all_orderings[i]);
    }
    instruction_set = DGFEM_SIMD_AUTO;
    check_blocks_free(&blocks);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_instruction_set_matches_the_dense_solution),
        cmocka_unit_test(instruction_sets_are_chosen_and_reported),
        cmocka_unit_test(grids_of_hexahedra_leave_residuals_of_round_off),
        cmocka_unit_test(long_chains_and_large_stars_are_solved),
        cmocka_unit_test(orders_are_permutations),
        cmocka_unit_test(counted_work_is_that_of_dense_elimination),
        cmocka_unit_test(dissection_needs_least_work_on_a_grid),
        cmocka_unit_test(dissection_narrows_rough_separators),
        cmocka_unit_test(automatic_choice_takes_what_needs_less_work),
        cmocka_unit_test(quick_choice_tries_dissection_of_large_grids_only),
        cmocka_unit_test(dissection_suits_meshes_of_nodes),
        cmocka_unit_test(minimum_degree_makes_no_fill_in_trees),
        cmocka_unit_test(failed_pivots_name_their_block),
        cmocka_unit_test(pivots_without_a_correct_digit_fail),
        cmocka_unit_test(scale_of_the_numbers_does_not_matter),
        cmocka_unit_test(other_patterns_are_refused),
        cmocka_unit_test(bad_arguments_are_refused),
        cmocka_unit_test(empty_system_is_solved),
        cmocka_unit_test(every_allocation_may_fail),
        cmocka_unit_test(updates_share_little_memory),
        cmocka_unit_test(repeated_factorizations_give_the_same_bits),
        cmocka_unit_test(many_right_hand_sides_are_solved_as_one),
        cmocka_unit_test(workers_change_no_bit),
        cmocka_unit_test(workers_name_the_same_failed_block),
        cmocka_unit_test(disconnected_graphs_and_dense_rows_are_solved),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
