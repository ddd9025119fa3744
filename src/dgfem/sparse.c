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

/* ---- shared products ---- */

/* A product in chunks of rows, which threads share. A chunk adds to its own rows of y; what its blocks give,
   transposed, to rows of earlier chunks, it leaves in `sums`, one piece for each such block. When all chunks are done
   the pieces are added, by the chunk whose rows they are for, in ascending order of the rows that they come from. So
   every part of y receives its products in the order of a product without chunks. */
struct dgfem_sharing {
    int chunk_count;
    int *row;         /* [chunk_count + 1] first row of each chunk, */
    size_t *diagonal; /* [chunk_count + 1] and how many numbers the diagonal blocks before it have */
    size_t *own;      /* [chunk_count + 1] where in sums the pieces of each chunk begin, in the order of its blocks */
    int *piece_start; /* [chunk_count + 1] and in the lists below, those for each chunk */
    int *target;      /* of each piece, by rows of y and for each by the rows that they come from: the row, */
    size_t *place;    /* and where it is in sums */
    dgfem_real *sums;
};

enum {
    DGFEM_LEAST_SHARED = 1 << 18, /* numbers in a matrix: less is not worth the wait for a thread; */
    DGFEM_CHUNK = 1 << 17,        /* in a chunk, about: the more chunks, the more pieces; */
    DGFEM_LEAST_CHUNKS = 6,
    DGFEM_MOST_CHUNKS = 16,
    DGFEM_SERIAL_SUMS = 1 << 15 /* so many numbers in pieces are added by one thread */
};

static void dgfemi_sharing_destroy(dgfem_sharing *sharing, const dgfem_hooks *hooks) {
    if (!sharing) return;
    dgfemi_free(hooks, sharing->row);
    dgfemi_free(hooks, sharing->diagonal);
    dgfemi_free(hooks, sharing->own);
    dgfemi_free(hooks, sharing->piece_start);
    dgfemi_free(hooks, sharing->target);
    dgfemi_free(hooks, sharing->place);
    dgfemi_free(hooks, sharing->sums);
    dgfemi_free(hooks, sharing);
}

/* Numbers in a diagonal block. */
static size_t dgfemi_square_of_size(const dgfem_matrix *matrix, int block) {
    size_t n = (size_t)(matrix->offset[block + 1] - matrix->offset[block]);
    return n * n;
}

/* Chunks of about the same number of stored numbers. */
static void dgfemi_sharing_set_rows(dgfem_sharing *sharing, const dgfem_matrix *matrix) {
    size_t total = matrix->value_start[matrix->row_start[matrix->block_count]], count = (size_t)sharing->chunk_count;
    size_t diagonal = 0;
    int c = 0, r;
    for (r = 0; r < matrix->block_count; r++)
        while (c < sharing->chunk_count && matrix->value_start[matrix->row_start[r]] >= total / count * (size_t)c)
            sharing->row[c++] = r;
    while (c <= sharing->chunk_count) sharing->row[c++] = matrix->block_count;
    for (r = 0, c = 0; r <= matrix->block_count; r++) {
        while (c <= sharing->chunk_count && sharing->row[c] == r) sharing->diagonal[c++] = diagonal;
        if (r < matrix->block_count) diagonal += dgfemi_square_of_size(matrix, r);
    }
}

/* The blocks of chunk c that are coupled to an earlier one have columns < row[c]. Visits them in their order: counts
   them by their columns in `pieces`, and with `sharing->place` sorts them, pieces[column] being where the next one
   goes. */
static void dgfemi_sharing_visit(dgfem_sharing *sharing, const dgfem_matrix *matrix, int *pieces) {
    size_t at = 0;
    int c, r, k;
    for (c = 0; c < sharing->chunk_count; c++) {
        sharing->own[c] = at;
        for (r = sharing->row[c]; r < sharing->row[c + 1]; r++)
            for (k = matrix->row_start[r]; k < matrix->row_start[r + 1] && matrix->column[k] < sharing->row[c]; k++) {
                int column = matrix->column[k];
                if (sharing->place) {
                    sharing->target[pieces[column]] = column;
                    sharing->place[pieces[column]] = at;
                }
                pieces[column]++;
                at += (size_t)(matrix->offset[column + 1] - matrix->offset[column]);
            }
    }
    sharing->own[c] = at;
}

/* 0 when out of memory. */
static int dgfemi_sharing_set_pieces(dgfem_sharing *sharing, const dgfem_matrix *matrix, int *pieces) {
    const dgfem_hooks *hooks = &matrix->hooks;
    size_t count;
    int c;
    dgfemi_sharing_visit(sharing, matrix, pieces);
    dgfemi_counts_to_starts(pieces, matrix->block_count);
    count = (size_t)pieces[matrix->block_count];
    for (c = 0; c <= sharing->chunk_count; c++) sharing->piece_start[c] = pieces[sharing->row[c]];
    sharing->target = (int *)dgfemi_allocate(hooks, count, sizeof(int));
    sharing->place = (size_t *)dgfemi_allocate(hooks, count, sizeof(size_t));
    sharing->sums = (dgfem_real *)dgfemi_allocate(hooks, sharing->own[sharing->chunk_count], sizeof(dgfem_real));
    if (!sharing->target || !sharing->place || !sharing->sums) return 0;
    dgfemi_sharing_visit(sharing, matrix, pieces);
    return 1;
}

/* Where the matrix is large enough and the host has threads. 0 when out of memory. */
static int dgfemi_matrix_share(dgfem_matrix *matrix, dgfemi_arena *arena) {
    const dgfem_hooks *hooks = &matrix->hooks;
    size_t total = matrix->value_start[matrix->row_start[matrix->block_count]], chunks = total / DGFEM_CHUNK;
    dgfem_sharing *sharing;
    int *pieces;
    if (!hooks->parallel_for || total < DGFEM_LEAST_SHARED) return 1;
    if (chunks < DGFEM_LEAST_CHUNKS) chunks = DGFEM_LEAST_CHUNKS;
    if (chunks > DGFEM_MOST_CHUNKS) chunks = DGFEM_MOST_CHUNKS;
    sharing = (dgfem_sharing *)dgfemi_allocate_zero(hooks, 1, sizeof *sharing);
    if (!sharing) return 0;
    matrix->sharing = sharing;
    sharing->chunk_count = (int)chunks;
    sharing->row = (int *)dgfemi_allocate(hooks, chunks + 1, sizeof(int));
    sharing->diagonal = (size_t *)dgfemi_allocate(hooks, chunks + 1, sizeof(size_t));
    sharing->own = (size_t *)dgfemi_allocate(hooks, chunks + 1, sizeof(size_t));
    sharing->piece_start = (int *)dgfemi_allocate(hooks, chunks + 1, sizeof(int));
    pieces = (int *)dgfemi_arena_allocate_zero(arena, (size_t)matrix->block_count + 1, sizeof(int));
    if (!sharing->row || !sharing->diagonal || !sharing->own || !sharing->piece_start || !pieces) return 0;
    dgfemi_sharing_set_rows(sharing, matrix);
    return dgfemi_sharing_set_pieces(sharing, matrix, pieces);
}

/* ---- the whole matrix ---- */

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
        built = built && dgfemi_matrix_share(matrix, &arena);
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
    dgfemi_sharing_destroy(matrix->sharing, &hooks);
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

/* y += A^T x for one strip; A^T x is summed up before it is added, as in kernels.c. */
DGFEM_INLINE void dgfemi_strip_multiply_transposed(const dgfem_real *a, int stride, int rows, int width,
                                                   const dgfem_real *x, dgfem_real *y) {
    dgfem_real sum[12] = {0};
    int i, j;
    for (i = 0; i < rows; i++, a += stride)
        for (j = 0; j < width; j++) sum[j] += a[j] * x[i];
    for (j = 0; j < width; j++) y[j] += sum[j];
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

/* y += A^T x, faster than y += A x: symmetric blocks are better multiplied so. `kernels` may be NULL. */
static void dgfemi_add_transposed_product(const dgfemi_kernels *kernels, const dgfem_real *block, int rows, int columns,
                                          const dgfem_real *x, dgfem_real *y) {
    if (kernels && columns >= 12) kernels->multiply_block(block, rows, columns, NULL, NULL, x, y);
    else dgfemi_block_multiply_transposed(block, rows, columns, x, y);
}

/* The rows first <= r < last of A, and their transposes. What is for rows before `first` goes to `sums`, block by
   block. */
static void dgfemi_multiply_rows(const dgfem_matrix *matrix, int first, int last, const dgfem_real *x, dgfem_real *y,
                                 dgfem_real *sums) {
    const dgfemi_kernels *kernels = dgfemi_product_kernels();
    int r, k;
    memset(y + matrix->offset[first], 0, (size_t)(matrix->offset[last] - matrix->offset[first]) * sizeof *y);
    for (r = first; r < last; r++) {
        int row = matrix->offset[r], rows = dgfemi_block_size(matrix, r);
        for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            const dgfem_real *block = matrix->values + matrix->value_start[k];
            int c = matrix->column[k], column = matrix->offset[c], columns = dgfemi_block_size(matrix, c);
            dgfem_real *transposed = y + column;
            if (c < first) {
                transposed = sums;
                memset(transposed, 0, (size_t)columns * sizeof *transposed);
                sums += columns;
            }
            if (kernels && columns >= 12) {
                int both = c != r;
                kernels->multiply_block(block, rows, columns, x + column, y + row, both ? x + row : NULL,
                                        both ? transposed : NULL);
                continue;
            }
            dgfemi_block_multiply(block, rows, columns, x + column, y + row);
            if (c != r) dgfemi_block_multiply_transposed(block, rows, columns, x + row, transposed);
        }
    }
}

typedef struct dgfemi_shared_product {
    const dgfem_matrix *matrix;
    const dgfem_real *x;
    dgfem_real *y;
} dgfemi_shared_product;

static void dgfemi_multiply_chunks(void *context, int first, int last) {
    const dgfemi_shared_product *product = (const dgfemi_shared_product *)context;
    const dgfem_sharing *sharing = product->matrix->sharing;
    int c;
    for (c = first; c < last; c++)
        dgfemi_multiply_rows(product->matrix, sharing->row[c], sharing->row[c + 1], product->x, product->y,
                             sharing->sums + sharing->own[c]);
}

static void dgfemi_add_pieces(void *context, int first, int last) {
    const dgfemi_shared_product *product = (const dgfemi_shared_product *)context;
    const dgfem_matrix *matrix = product->matrix;
    const dgfem_sharing *sharing = matrix->sharing;
    int k, i;
    for (k = sharing->piece_start[first]; k < sharing->piece_start[last]; k++) {
        const dgfem_real *piece = sharing->sums + sharing->place[k];
        dgfem_real *y = product->y + matrix->offset[sharing->target[k]];
        for (i = 0; i < dgfemi_block_size(matrix, sharing->target[k]); i++) y[i] += piece[i];
    }
}

/* Every part of y receives its products in ascending order of the block that they come from: first its own row, then,
   transposed, the rows below. */
DGFEM_API void dgfem_matrix_multiply(const dgfem_matrix *matrix, const dgfem_real *x, dgfem_real *y) {
    dgfemi_shared_product product;
    int chunks;
    if (!matrix || !x || !y) return;
    if (!matrix->sharing) {
        dgfemi_multiply_rows(matrix, 0, matrix->block_count, x, y, NULL);
        return;
    }
    product.matrix = matrix, product.x = x, product.y = y;
    chunks = matrix->sharing->chunk_count;
    dgfemi_parallel_for(&matrix->hooks, chunks, 1, dgfemi_multiply_chunks, &product);
    if (matrix->sharing->own[chunks] <= DGFEM_SERIAL_SUMS) dgfemi_add_pieces(&product, 0, chunks);
    else dgfemi_parallel_for(&matrix->hooks, chunks, 1, dgfemi_add_pieces, &product);
}

/* A loop over the blocks of a matrix whose results do not depend on each other. `diagonal` is how many numbers the
   diagonal blocks before `first` have. */
typedef void (*dgfemi_rows_fn)(void *context, const dgfem_matrix *matrix, int first, int last, size_t diagonal);

typedef struct dgfemi_rows_loop {
    const dgfem_matrix *matrix;
    dgfemi_rows_fn fn;
    void *context;
} dgfemi_rows_loop;

static void dgfemi_rows_of_chunks(void *context, int first, int last) {
    const dgfemi_rows_loop *loop = (const dgfemi_rows_loop *)context;
    const dgfem_sharing *sharing = loop->matrix->sharing;
    loop->fn(loop->context, loop->matrix, sharing->row[first], sharing->row[last], sharing->diagonal[first]);
}

/* By the chunks that threads share. */
static void dgfemi_for_rows(const dgfem_matrix *matrix, dgfemi_rows_fn fn, void *context) {
    dgfemi_rows_loop loop;
    if (!matrix->sharing) {
        fn(context, matrix, 0, matrix->block_count, 0);
        return;
    }
    loop.matrix = matrix, loop.fn = fn, loop.context = context;
    dgfemi_parallel_for(&matrix->hooks, matrix->sharing->chunk_count, 1, dgfemi_rows_of_chunks, &loop);
}
