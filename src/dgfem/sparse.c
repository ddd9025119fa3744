#pragma once
#include "base.c"
#include "panel.c"
/* Symmetric matrix in dense blocks of any sizes. Stored is the lower half, by rows of blocks. */

DGFEM_API dgfem_matrix_desc dgfem_default_matrix_desc(void) {
    dgfem_matrix_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    return desc;
}

/* ---- creation ---- */

/* Stored blocks are counted in int, and so are the two entries that each makes in the graph of blocks. */
#define DGFEM_MAX_MATRIX_BLOCKS (INT_MAX / 4)

static dgfem_status dgfemi_matrix_check_blocks(const dgfem_matrix_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    int size = 0, i;
    if (desc->block_count < 0 || (desc->block_count > 0 && !desc->block_sizes))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: no sizes for %d blocks", desc->block_count);
    for (i = 0; i < desc->block_count; i++) {
        if (desc->block_sizes[i] < 1)
            return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: block %d has size %d", i, desc->block_sizes[i]);
        if (desc->block_sizes[i] > INT_MAX - size)
            return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: block %d makes it larger than INT_MAX", i);
        size += desc->block_sizes[i];
    }
    for (i = 0; desc->centres && i < desc->block_count; i++) {
        dgfem_vec3 c = desc->centres[i];
        if (!dgfemi_is_finite(c.x) || !dgfemi_is_finite(c.y) || !dgfemi_is_finite(c.z))
            return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "matrix: centre of block %d", i);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_matrix_check_pairs(const dgfem_matrix_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    int i;
    if (desc->pair_count < 0 || (desc->pair_count > 0 && !desc->pairs))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: no data for %d pairs", desc->pair_count);
    if (desc->pair_count > DGFEM_MAX_MATRIX_BLOCKS || desc->block_count > DGFEM_MAX_MATRIX_BLOCKS - desc->pair_count)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: %d blocks and %d pairs are too many",
                           desc->block_count, desc->pair_count);
    for (i = 0; i < desc->pair_count; i++) {
        const int *pair = desc->pairs + 2 * (size_t)i;
        if (pair[0] < 0 || pair[0] >= desc->block_count || pair[1] < 0 || pair[1] >= desc->block_count)
            return dgfemi_fail(hooks, DGFEM_ERROR_INDEX, "matrix: pair %d couples blocks %d and %d of %d", i, pair[0],
                               pair[1], desc->block_count);
    }
    return DGFEM_OK;
}

/* Turns counts[i], the number of items in bucket i, into the place of the bucket's first item; counts[buckets] becomes
   the number of all. */
static void dgfemi_counts_to_starts(int *counts, int buckets) {
    int i, total = 0;
    for (i = 0; i < buckets; i++) {
        int count = counts[i];
        counts[i] = total;
        total += count;
    }
    counts[buckets] = total;
}

/* After filling, starts[i] has moved to the end of bucket i: moves all back. */
static void dgfemi_restore_starts(int *starts, int buckets) {
    int i;
    for (i = buckets; i > 0; i--) starts[i] = starts[i - 1];
    starts[0] = 0;
}

/* The pairs below the diagonal, sorted by column: row[k], starts[column] <= k < starts[column + 1]; with repeats. */
static void dgfemi_pairs_by_column(const dgfem_matrix_desc *desc, int *starts, int *row) {
    int pass, i;
    memset(starts, 0, ((size_t)desc->block_count + 1) * sizeof *starts);
    for (pass = 0; pass < 2; pass++) {
        for (i = 0; i < desc->pair_count; i++) {
            int a = desc->pairs[2 * (size_t)i], b = desc->pairs[2 * (size_t)i + 1];
            if (a == b) continue;
            if (pass == 0) starts[a < b ? a : b]++;
            else row[starts[a < b ? a : b]++] = a < b ? b : a;
        }
        if (pass == 0) dgfemi_counts_to_starts(starts, desc->block_count);
    }
    dgfemi_restore_starts(starts, desc->block_count);
}

/* Visits the columns in ascending order and appends each to its rows, the diagonal's included: so every row's columns
   ascend, and a repeat can only repeat the last one. With column NULL this counts, with it, end[r] is where the next
   column of row r goes. last[block_count] is scratch. */
static void dgfemi_append_columns(int block_count, const int *starts, const int *row, int *last, int *end,
                                  int *column) {
    int j, k;
    for (j = 0; j < block_count; j++) last[j] = DGFEM_NONE;
    for (j = 0; j < block_count; j++)
        for (k = starts[j]; k <= starts[j + 1]; k++) {
            int r = k < starts[j + 1] ? row[k] : j;
            if (last[r] == j) continue;
            last[r] = j;
            if (column) column[end[r]] = j;
            end[r]++;
        }
}

static int dgfemi_matrix_pattern(dgfem_matrix *matrix, const dgfem_matrix_desc *desc, dgfemi_arena *arena) {
    int n = desc->block_count;
    int *starts = (int *)dgfemi_arena_allocate(arena, (size_t)n + 1, sizeof(int));
    int *row = (int *)dgfemi_arena_allocate(arena, (size_t)desc->pair_count, sizeof(int));
    int *last = (int *)dgfemi_arena_allocate(arena, (size_t)n, sizeof(int));
    matrix->row_start = (int *)dgfemi_allocate_zero(&matrix->hooks, (size_t)n + 1, sizeof(int));
    if (!starts || !row || !last || !matrix->row_start) return 0;
    dgfemi_pairs_by_column(desc, starts, row);
    dgfemi_append_columns(n, starts, row, last, matrix->row_start, NULL);
    dgfemi_counts_to_starts(matrix->row_start, n);
    matrix->column = (int *)dgfemi_allocate(&matrix->hooks, (size_t)matrix->row_start[n], sizeof(int));
    if (!matrix->column) return 0;
    dgfemi_append_columns(n, starts, row, last, matrix->row_start, matrix->column);
    dgfemi_restore_starts(matrix->row_start, n);
    return 1;
}

/* total + a * b; where that is more than any array can hold, a number that no allocation accepts. */
static size_t dgfemi_add_product(size_t total, size_t a, size_t b) {
    const size_t limit = (size_t)PTRDIFF_MAX;
    return a && b > (limit - total) / a ? limit : total + a * b;
}

/* Needs the pattern. */
static int dgfemi_matrix_values(dgfem_matrix *matrix, const dgfem_matrix_desc *desc) {
    size_t total = 0;
    int stored = matrix->row_start[matrix->block_count], r, k;
    matrix->offset = (int *)dgfemi_allocate(&matrix->hooks, (size_t)matrix->block_count + 1, sizeof(int));
    matrix->value_start = (size_t *)dgfemi_allocate(&matrix->hooks, (size_t)stored + 1, sizeof(size_t));
    if (!matrix->offset || !matrix->value_start) return 0;
    for (r = 0; r < matrix->block_count; r++) {
        matrix->offset[r] = matrix->size;
        matrix->size += desc->block_sizes[r];
        for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            matrix->value_start[k] = total;
            total =
                dgfemi_add_product(total, (size_t)desc->block_sizes[r], (size_t)desc->block_sizes[matrix->column[k]]);
        }
    }
    matrix->offset[matrix->block_count] = matrix->size;
    matrix->value_start[stored] = total;
    matrix->values = (dgfem_real *)dgfemi_allocate_zero(&matrix->hooks, total, sizeof(dgfem_real));
    return matrix->values != NULL;
}

/* NULL when out of memory. */
static dgfem_matrix *dgfemi_matrix_build(const dgfem_matrix_desc *desc) {
    dgfemi_arena arena = dgfemi_arena_make(&desc->hooks);
    dgfem_matrix *matrix = (dgfem_matrix *)dgfemi_allocate_zero(&desc->hooks, 1, sizeof *matrix);
    int built = 0;
    if (matrix) {
        matrix->hooks = desc->hooks;
        matrix->block_count = desc->block_count;
        built = dgfemi_matrix_pattern(matrix, desc, &arena) && dgfemi_matrix_values(matrix, desc);
        if (built && desc->centres) {
            matrix->centres = (dgfem_vec3 *)dgfemi_duplicate(&desc->hooks, desc->centres, (size_t)desc->block_count,
                                                             sizeof(dgfem_vec3));
            built = matrix->centres != NULL;
        }
    }
    dgfemi_arena_free(&arena);
    if (built) return matrix;
    dgfem_matrix_destroy(matrix);
    return NULL;
}

DGFEM_API dgfem_status dgfem_matrix_create(const dgfem_matrix_desc *desc, dgfem_matrix **out) {
    dgfem_status status;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "matrix: out is NULL");
    status = dgfemi_matrix_check_blocks(desc);
    if (!status) status = dgfemi_matrix_check_pairs(desc);
    if (status) return status;
    *out = dgfemi_matrix_build(desc);
    return *out ? DGFEM_OK : dgfemi_fail_memory(&desc->hooks);
}

DGFEM_API void dgfem_matrix_destroy(dgfem_matrix *matrix) {
    dgfem_hooks hooks;
    if (!matrix) return;
    hooks = matrix->hooks;
    dgfemi_free(&hooks, matrix->offset);
    dgfemi_free(&hooks, matrix->row_start);
    dgfemi_free(&hooks, matrix->column);
    dgfemi_free(&hooks, matrix->value_start);
    dgfemi_free(&hooks, matrix->values);
    dgfemi_free(&hooks, matrix->centres);
    dgfemi_free(&hooks, matrix);
}

/* ---- access ---- */

static int dgfemi_block_size(const dgfem_matrix *matrix, int block) {
    return matrix->offset[block + 1] - matrix->offset[block];
}

/* Where the diagonal block of a row is stored: it is the row's last one. */
static int dgfemi_diagonal_index(const dgfem_matrix *matrix, int row) { return matrix->row_start[row + 1] - 1; }

DGFEM_API void dgfem_matrix_clear(dgfem_matrix *matrix) {
    if (!matrix) return;
    memset(matrix->values, 0, matrix->value_start[matrix->row_start[matrix->block_count]] * sizeof(dgfem_real));
}

DGFEM_API dgfem_real *dgfem_matrix_block(const dgfem_matrix *matrix, int row, int column) {
    int low, high;
    if (!matrix || row < 0 || row >= matrix->block_count || column < 0 || column > row) return NULL;
    low = matrix->row_start[row];
    high = dgfemi_diagonal_index(matrix, row);
    while (low < high) { /* the first index with column[index] >= column is in low..high */
        int middle = low + (high - low) / 2;
        if (matrix->column[middle] < column) low = middle + 1;
        else high = middle;
    }
    return matrix->column[low] == column ? matrix->values + matrix->value_start[low] : NULL;
}

/* The index of the first number that is NaN or infinite, or DGFEM_NONE. */
static int dgfemi_vector_not_finite(int count, const dgfem_real *x) {
    int i;
    for (i = 0; i < count; i++)
        if (!dgfemi_is_finite(x[i])) return i;
    return DGFEM_NONE;
}

/* ---- product ---- */

/* Both functions treat a block in strips of 12, 3 and 1 columns: all loops over a strip have a constant length and its
   vector lives in registers. */

/* y += A x for one strip; `stride` is the length of a row of the block. */
DGFEM_INLINE void dgfemi_strip_multiply(const dgfem_real *a, int stride, int rows, int width, const dgfem_real *x,
                                        dgfem_real *y) {
    dgfem_real v[12] = {0};
    int i, j;
    for (j = 0; j < width; j++) v[j] = x[j];
    for (i = 0; i < rows; i++, a += stride) {
        dgfem_real sum[4] = {0};
        if (width == 12) {
            for (j = 0; j < 4; j++) sum[j] = a[j] * v[j] + a[j + 4] * v[j + 4] + a[j + 8] * v[j + 8];
        } else
            for (j = 0; j < width; j++) sum[j] = a[j] * v[j];
        y[i] += (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
}

/* y += A^T x for one strip. */
DGFEM_INLINE void dgfemi_strip_multiply_transposed(const dgfem_real *a, int stride, int rows, int width,
                                                   const dgfem_real *x, dgfem_real *y) {
    dgfem_real sum[12];
    int i, j;
    for (j = 0; j < width; j++) sum[j] = y[j];
    for (i = 0; i < rows; i++, a += stride)
        for (j = 0; j < width; j++) sum[j] += a[j] * x[i];
    for (j = 0; j < width; j++) y[j] = sum[j];
}

static void dgfemi_block_multiply(const dgfem_real *a, int rows, int columns, const dgfem_real *x, dgfem_real *y) {
    int j = 0;
    for (; j + 12 <= columns; j += 12) dgfemi_strip_multiply(a + j, columns, rows, 12, x + j, y);
    for (; j + 3 <= columns; j += 3) dgfemi_strip_multiply(a + j, columns, rows, 3, x + j, y);
    for (; j < columns; j++) dgfemi_strip_multiply(a + j, columns, rows, 1, x + j, y);
}

static void dgfemi_block_multiply_transposed(const dgfem_real *a, int rows, int columns, const dgfem_real *x,
                                             dgfem_real *y) {
    int j = 0;
    for (; j + 12 <= columns; j += 12) dgfemi_strip_multiply_transposed(a + j, columns, rows, 12, x, y + j);
    for (; j + 3 <= columns; j += 3) dgfemi_strip_multiply_transposed(a + j, columns, rows, 3, x, y + j);
    for (; j < columns; j++) dgfemi_strip_multiply_transposed(a + j, columns, rows, 1, x, y + j);
}

/* The kernels that multiply large blocks faster than what the compiler makes of the functions above: where four reals
   make a vector, three of them a row of 12. NULL where there are none. */
static const dgfemi_kernels *dgfemi_product_kernels(void) {
    return dgfemi_kernels_for(DGFEM_REAL_IS_FLOAT ? DGFEM_SIMD_SSE2 : DGFEM_SIMD_AVX2);
}

/* Every part of y receives its products in ascending order of the block that they come from: first its own row, then,
   transposed, the rows below. A loop over the parts of y in place of the rows of A, which several threads can share,
   gives therefore the same bits; it reads each block twice. */
DGFEM_API void dgfem_matrix_multiply(const dgfem_matrix *matrix, const dgfem_real *x, dgfem_real *y) {
    const dgfemi_kernels *kernels = dgfemi_product_kernels();
    int r, k;
    if (!matrix || !x || !y) return;
    memset(y, 0, (size_t)matrix->size * sizeof *y);
    for (r = 0; r < matrix->block_count; r++) {
        int row = matrix->offset[r], rows = dgfemi_block_size(matrix, r);
        for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            const dgfem_real *block = matrix->values + matrix->value_start[k];
            int column = matrix->offset[matrix->column[k]], columns = dgfemi_block_size(matrix, matrix->column[k]);
            if (kernels && columns >= 12) {
                int both = column != row;
                kernels->multiply_block(block, rows, columns, x + column, y + row, both ? x + row : NULL,
                                        both ? y + column : NULL);
                continue;
            }
            dgfemi_block_multiply(block, rows, columns, x + column, y + row);
            if (column != row) dgfemi_block_multiply_transposed(block, rows, columns, x + row, y + column);
        }
    }
}
