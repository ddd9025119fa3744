/* Shared by the tests of the sparse solvers: block systems of many structures, and a dense reference for them. Include
   it after check.h. */
#ifndef CHECK_MATRIX_H
#define CHECK_MATRIX_H

/* ---- structures ---- */

typedef struct check_blocks {
    int count, pair_count, pair_room;
    int *sizes;
    int *pairs;
    dgfem_vec3 *centres;
} check_blocks;

/* `count` blocks of size `size`, uncoupled, along the x-axis. */
static inline check_blocks check_blocks_make(int count, int size) {
    check_blocks blocks;
    int i;
    memset(&blocks, 0, sizeof blocks);
    blocks.count = count;
    blocks.sizes = (int *)calloc((size_t)count + 1, sizeof(int));
    blocks.centres = (dgfem_vec3 *)calloc((size_t)count + 1, sizeof(dgfem_vec3));
    assert_true(blocks.sizes && blocks.centres);
    for (i = 0; i < count; i++) {
        blocks.sizes[i] = size;
        blocks.centres[i].x = (dgfem_real)i;
    }
    return blocks;
}

static inline void check_blocks_free(check_blocks *blocks) {
    free(blocks->sizes);
    free(blocks->pairs);
    free(blocks->centres);
}

static inline void check_blocks_couple(check_blocks *blocks, int a, int b) {
    if (blocks->pair_count == blocks->pair_room) {
        blocks->pair_room = 2 * blocks->pair_room + 16;
        blocks->pairs = (int *)realloc(blocks->pairs, 2 * (size_t)blocks->pair_room * sizeof(int));
        assert_non_null(blocks->pairs);
    }
    blocks->pairs[2 * blocks->pair_count] = a;
    blocks->pairs[2 * blocks->pair_count + 1] = b;
    blocks->pair_count++;
}

/* Hexahedra coupled across their faces. */
static inline check_blocks check_blocks_grid(int nx, int ny, int nz, int size) {
    check_blocks blocks = check_blocks_make(nx * ny * nz, size);
    int i;
    for (i = 0; i < blocks.count; i++) {
        int x = i % nx, y = i / nx % ny, z = i / (nx * ny);
        blocks.centres[i].x = (dgfem_real)x;
        blocks.centres[i].y = (dgfem_real)y;
        blocks.centres[i].z = (dgfem_real)z;
        if (x > 0) check_blocks_couple(&blocks, i, i - 1);
        if (y > 0) check_blocks_couple(&blocks, i - nx, i);
        if (z > 0) check_blocks_couple(&blocks, i, i - nx * ny);
    }
    return blocks;
}

static inline check_blocks check_blocks_chain(int count, int size) {
    check_blocks blocks = check_blocks_make(count, size);
    int i;
    for (i = 1; i < count; i++) check_blocks_couple(&blocks, i - 1, i);
    return blocks;
}

/* Every block coupled to the one in the middle. */
static inline check_blocks check_blocks_star(int count, int size) {
    check_blocks blocks = check_blocks_make(count, size);
    int i;
    for (i = 0; i < count; i++)
        if (i != count / 2) check_blocks_couple(&blocks, i, count / 2);
    return blocks;
}

/* Every block coupled to every other. */
static inline check_blocks check_blocks_complete(int count, int size) {
    check_blocks blocks = check_blocks_make(count, size);
    int i, j;
    for (i = 0; i < count; i++)
        for (j = 0; j < i; j++) check_blocks_couple(&blocks, i, j);
    return blocks;
}

/* Sizes of 1, 3, 4, 12, 30 and 60, small ones more often; pairs at random, some repeated, turned round or of a block
   with itself. */
static inline check_blocks check_blocks_random(check_random *random, int count, int pairs) {
    static const int sizes[12] = {1, 1, 3, 3, 3, 4, 4, 12, 12, 12, 30, 60};
    check_blocks blocks = check_blocks_make(count, 1);
    int i;
    for (i = 0; i < count; i++) {
        blocks.sizes[i] = sizes[check_random_int(random, 12)];
        blocks.centres[i] = check_random_vec3(random, -1, 1);
    }
    for (i = 0; i < pairs; i++) {
        int a = check_random_int(random, count), b = check_random_int(random, count);
        check_blocks_couple(&blocks, a, b);
        if (i % 5 == 0) check_blocks_couple(&blocks, b, a);
    }
    return blocks;
}

/* ---- matrices ---- */

static inline dgfem_matrix_desc check_matrix_desc(const check_blocks *blocks, int with_centres) {
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    desc.block_count = blocks->count;
    desc.block_sizes = blocks->sizes;
    desc.pairs = blocks->pairs;
    desc.pair_count = blocks->pair_count;
    desc.centres = with_centres ? blocks->centres : NULL;
    return desc;
}

static inline dgfem_matrix *check_matrix_make(const check_blocks *blocks, int with_centres) {
    dgfem_matrix_desc desc = check_matrix_desc(blocks, with_centres);
    dgfem_matrix *matrix = NULL;
    check_status(dgfem_matrix_create(&desc, &matrix), DGFEM_OK);
    return matrix;
}

static inline int check_matrix_size(const dgfem_matrix *matrix, int block) {
    return matrix->offset[block + 1] - matrix->offset[block];
}

/* Random numbers off the diagonal; each diagonal element is `dominance` times the sum of the others in its row, so that
   the condition is about (dominance + 1) / (dominance - 1) where all rows have sums of about one size. */
static inline void check_matrix_fill(dgfem_matrix *matrix, check_random *random, double dominance) {
    double *sum = (double *)calloc((size_t)matrix->size + 1, sizeof(double));
    int r, k, i, j;
    assert_non_null(sum);
    for (r = 0; r < matrix->block_count; r++)
        for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            int c = matrix->column[k], rows = check_matrix_size(matrix, r), columns = check_matrix_size(matrix, c);
            dgfem_real *block = matrix->values + matrix->value_start[k];
            for (i = 0; i < rows; i++)
                for (j = 0; j < (c == r ? i : columns); j++) {
                    double value = check_random_real(random, -1, 1);
                    block[i * columns + j] = (dgfem_real)value;
                    if (c == r) block[j * columns + i] = (dgfem_real)value;
                    sum[matrix->offset[r] + i] += fabs(value);
                    sum[matrix->offset[c] + j] += fabs(value);
                }
        }
    for (r = 0; r < matrix->block_count; r++) {
        dgfem_real *block = dgfem_matrix_block(matrix, r, r);
        int rows = check_matrix_size(matrix, r);
        for (i = 0; i < rows; i++) block[i * rows + i] = (dgfem_real)(dominance * sum[matrix->offset[r] + i] + 0.5);
    }
    free(sum);
}

static inline dgfem_real *check_vector_random(check_random *random, int count) {
    dgfem_real *x = (dgfem_real *)calloc((size_t)count + 1, sizeof(dgfem_real));
    int i;
    assert_non_null(x);
    for (i = 0; i < count; i++) x[i] = (dgfem_real)check_random_real(random, -1, 1);
    return x;
}

/* ---- dense reference, in double ---- */

/* The whole matrix, both halves, row-major. */
static inline double *check_dense(const dgfem_matrix *matrix) {
    size_t n = (size_t)matrix->size;
    double *dense = (double *)calloc(n * n + 1, sizeof(double));
    int r, k, i, j;
    assert_non_null(dense);
    for (r = 0; r < matrix->block_count; r++)
        for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            int c = matrix->column[k], columns = check_matrix_size(matrix, c);
            const dgfem_real *block = matrix->values + matrix->value_start[k];
            for (i = 0; i < check_matrix_size(matrix, r); i++)
                for (j = 0; j < columns; j++) {
                    size_t row = (size_t)(matrix->offset[r] + i), column = (size_t)(matrix->offset[c] + j);
                    dense[row * n + column] = dense[column * n + row] = (double)block[i * columns + j];
                }
        }
    return dense;
}

/* x = A^-1 b by Gaussian elimination with partial pivoting; destroys A. */
static inline double *check_dense_solve(double *a, int n, const dgfem_real *b) {
    double *x = (double *)calloc((size_t)n + 1, sizeof(double));
    int i, j, k;
    assert_non_null(x);
    for (i = 0; i < n; i++) x[i] = (double)b[i];
    for (k = 0; k < n; k++) {
        int pivot = k;
        for (i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[pivot * n + k])) pivot = i;
        for (j = k; j < n && pivot != k; j++) {
            double swap = a[k * n + j];
            a[k * n + j] = a[pivot * n + j];
            a[pivot * n + j] = swap;
        }
        if (pivot != k) {
            double swap = x[k];
            x[k] = x[pivot];
            x[pivot] = swap;
        }
        for (i = k + 1; i < n; i++) {
            double factor = a[i * n + k] / a[k * n + k];
            if (factor == 0) continue;
            for (j = k; j < n; j++) a[i * n + j] -= factor * a[k * n + j];
            x[i] -= factor * x[k];
        }
    }
    for (i = n - 1; i >= 0; i--) {
        for (j = i + 1; j < n; j++) x[i] -= a[i * n + j] * x[j];
        x[i] /= a[i * n + i];
    }
    return x;
}

/* Largest |b - A x| over the largest of |A| |x| + |b|, in double and by the stored blocks, not by the library's
   product: about epsilon for a backward stable solution. NaN gives NaN. */
static inline double check_residual(const dgfem_matrix *matrix, const dgfem_real *b, const dgfem_real *x) {
    double *rest = (double *)calloc((size_t)matrix->size + 1, sizeof(double));
    double *scale = (double *)calloc((size_t)matrix->size + 1, sizeof(double));
    double worst = 0, largest = 0;
    int r, k, i, j;
    assert_true(rest && scale);
    for (i = 0; i < matrix->size; i++) rest[i] = (double)b[i], scale[i] = fabs((double)b[i]);
    for (r = 0; r < matrix->block_count; r++)
        for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            int c = matrix->column[k], columns = check_matrix_size(matrix, c);
            const dgfem_real *block = matrix->values + matrix->value_start[k];
            for (i = 0; i < check_matrix_size(matrix, r); i++)
                for (j = 0; j < columns; j++) {
                    double a = (double)block[i * columns + j];
                    int row = matrix->offset[r] + i, column = matrix->offset[c] + j;
                    rest[row] -= a * (double)x[column];
                    scale[row] += fabs(a * (double)x[column]);
                    if (c == r) continue;
                    rest[column] -= a * (double)x[row];
                    scale[column] += fabs(a * (double)x[row]);
                }
        }
    for (i = 0; i < matrix->size; i++) {
        if (!(fabs(rest[i]) <= worst)) worst = fabs(rest[i]);
        if (scale[i] > largest) largest = scale[i];
    }
    free(rest);
    free(scale);
    return largest > 0 ? worst / largest : worst;
}

#endif
