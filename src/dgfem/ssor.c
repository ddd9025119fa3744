#pragma once
#include "basis.c"
#include "pcg.c"
/* Symmetric Gauss-Seidel sweeps over the blocks as a preconditioner of conjugate gradients: with D the diagonal blocks
   of A and L those below,

       A = D + L + L^T,   P = (D + L) D^-1 (D + L)^T.

   By the trick of Eisenstat (1981) the iteration runs in the variables of (D + L)^T x, where the matrix is

       (D + L)^-1 A (D + L)^-T p = t + (D + L)^-1 (p - D t),   t = (D + L)^-T p,

   and P is D^-1. So an iteration costs the two sweeps, which are a product with A in disguise, and no product besides. */

enum { DGFEM_MAX_BLOCK = 3 * DGFEM_MAX_BASIS }; /* unknowns of an element */

typedef struct dgfemi_ssor {
    const dgfem_matrix *matrix;
    const dgfemi_kernels *kernels; /* or NULL */
    dgfem_real *inverse;           /* of the diagonal blocks */
} dgfemi_ssor;

/* Reals that `inverse` needs. */
static size_t dgfemi_diagonal_size(const dgfem_matrix *matrix) {
    size_t total = 0;
    for (int r = 0; r < matrix->block_count; r++) {
        size_t n = (size_t)dgfemi_block_size(matrix, r);
        total += n * n;
    }
    return total;
}

/* y += A x */
static void dgfemi_add_product_of(const dgfemi_ssor *s, const dgfem_real *block, int rows, int columns,
                                  const dgfem_real *x, dgfem_real *y) {
    if (s->kernels && columns >= 12) s->kernels->multiply_block(block, rows, columns, x, y, NULL, NULL);
    else dgfemi_block_multiply(block, rows, columns, x, y);
}

/* x = (D + L)^-1 x. The diagonal blocks and their inverses are symmetric: transposed products are faster. */
static void dgfemi_ssor_forward(const dgfemi_ssor *s, dgfem_real *x) {
    const dgfem_matrix *matrix = s->matrix;
    const dgfem_real *inverse = s->inverse;
    dgfem_real sum[DGFEM_MAX_BLOCK];
    for (int r = 0; r < matrix->block_count; r++) {
        int n = dgfemi_block_size(matrix, r);
        dgfem_real *own = x + matrix->offset[r];
        memset(sum, 0, (size_t)n * sizeof *sum);
        for (int k = matrix->row_start[r]; k < dgfemi_diagonal_index(matrix, r); k++)
            dgfemi_add_product_of(s, matrix->values + matrix->value_start[k], n,
                                  dgfemi_block_size(matrix, matrix->column[k]), x + matrix->offset[matrix->column[k]],
                                  sum);
        for (int i = 0; i < n; i++) sum[i] = own[i] - sum[i];
        memset(own, 0, (size_t)n * sizeof *own);
        dgfemi_add_transposed_product(s->kernels, inverse, n, n, sum, own);
        inverse += (size_t)n * (size_t)n;
    }
}

/* t = (D + L)^-T p, rest = p - D t = L^T t */
static void dgfemi_ssor_backward(const dgfemi_ssor *s, const dgfem_real *p, dgfem_real *t, dgfem_real *rest) {
    const dgfem_matrix *matrix = s->matrix;
    const dgfem_real *inverse = s->inverse + dgfemi_diagonal_size(matrix);
    dgfem_real difference[DGFEM_MAX_BLOCK];
    memset(t, 0, (size_t)matrix->size * sizeof *t);
    memset(rest, 0, (size_t)matrix->size * sizeof *rest);
    for (int r = matrix->block_count - 1; r >= 0; r--) {
        int n = dgfemi_block_size(matrix, r), first = matrix->offset[r];
        inverse -= (size_t)n * (size_t)n;
        for (int i = 0; i < n; i++) difference[i] = p[first + i] - rest[first + i];
        dgfemi_add_transposed_product(s->kernels, inverse, n, n, difference, t + first);
        for (int k = matrix->row_start[r]; k < dgfemi_diagonal_index(matrix, r); k++)
            dgfemi_add_transposed_product(s->kernels, matrix->values + matrix->value_start[k], n,
                                          dgfemi_block_size(matrix, matrix->column[k]), t + first,
                                          rest + matrix->offset[matrix->column[k]]);
    }
}

typedef struct dgfemi_ssor_vectors {
    const dgfem_real *r;
    dgfem_real *z;
} dgfemi_ssor_vectors;

static void dgfemi_ssor_diagonal_rows(void *context, const dgfem_matrix *matrix, int first, int last, size_t diagonal) {
    const dgfemi_ssor_vectors *vectors = (const dgfemi_ssor_vectors *)context;
    const dgfemi_kernels *kernels = dgfemi_product_kernels();
    (void)diagonal;
    memset(vectors->z + matrix->offset[first], 0,
           (size_t)(matrix->offset[last] - matrix->offset[first]) * sizeof(dgfem_real));
    for (int k = first; k < last; k++) {
        int n = dgfemi_block_size(matrix, k), at = matrix->offset[k];
        dgfemi_add_transposed_product(kernels, matrix->values + matrix->value_start[dgfemi_diagonal_index(matrix, k)],
                                      n, n, vectors->r + at, vectors->z + at);
    }
}

/* z = D r */
static void dgfemi_ssor_diagonal(const dgfemi_ssor *s, const dgfem_real *r, dgfem_real *z) {
    dgfemi_ssor_vectors vectors;
    vectors.r = r, vectors.z = z;
    dgfemi_for_rows(s->matrix, dgfemi_ssor_diagonal_rows, &vectors);
}
